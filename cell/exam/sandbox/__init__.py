"""The process that judges a case and can open nothing but its runs."""
