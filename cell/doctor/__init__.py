"""Doctor of a cell: numbered checks, each with a remedy, whether it may move a robot."""
