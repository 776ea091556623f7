"""Runs of a case, simulated from the state or folded by the cell through images."""
