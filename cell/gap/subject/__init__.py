"""Subjects of the gap workflow: strips and mechanisms, their runs, and their simulation."""
