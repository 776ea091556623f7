"""Sandbox of the exam: a process that judges a case and can open nothing but its runs."""
