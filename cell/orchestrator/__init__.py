"""Orchestration of a run: the control loop, its monitors, and a generator for each state."""
