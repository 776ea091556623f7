"""Configuration of a cell: files, their look-up, and what is wrong with them in one line."""
