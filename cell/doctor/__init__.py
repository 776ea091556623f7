"""Whether this machine and cell may move a robot: numbered checks, each with its remedy."""
