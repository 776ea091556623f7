"""Laboratory: measurements of the cell by its makers, as `python -m tests.lab
COMMAND`.
"""
