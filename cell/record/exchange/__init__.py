"""Exchange of runs with other programs: their tables are read and written as run
folders.
"""
