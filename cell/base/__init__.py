"""Configuration of a cell, its opened devices, measurements spread over processes."""
