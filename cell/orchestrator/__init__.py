"""Runs one fold: the control loop, and a generator for each state."""
