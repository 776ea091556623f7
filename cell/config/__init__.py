"""Configuration of a cell: files, their location, and errors in one line."""
