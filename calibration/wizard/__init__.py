"""The calibration wizards: what to show or touch next and why, what came of it, kept and solved again."""
