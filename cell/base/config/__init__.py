"""Configuration of a cell: its files and their locations, and errors in one line of
text.
"""
