"""Folding a strip that nobody measured: a critic foresees d, the path is moved until it is 0."""
