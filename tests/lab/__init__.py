"""The laboratory: what the makers of the cell measure of it, through `python -m tests.lab`."""
