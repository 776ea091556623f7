"""Command line of the cell, one file for each command."""
