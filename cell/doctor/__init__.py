"""Doctor of a cell: checks, each with a remedy, that decide whether a robot may move."""
