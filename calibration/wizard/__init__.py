"""Calibration wizards: what to show or touch next and why, and the result."""
