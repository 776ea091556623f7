"""Report of an exam: a page in Markdown with figures."""
