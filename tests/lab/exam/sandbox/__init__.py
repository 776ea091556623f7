"""Sandbox of the exam: a process that diagnoses a case and can open nothing but its runs."""
