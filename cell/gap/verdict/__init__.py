"""The verdict: what the stages found, what follows from it, and its acceptance."""
