"""Configuration of a cell: its files, where they are, and errors in one line."""
