"""Command line of the cell: a file for the commands on one thing."""
