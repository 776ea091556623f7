"""Runs one fold: the control loop, and one generator per state of the run."""
