"""The calibration wizards: what to show or touch next and why, and what came of it."""
