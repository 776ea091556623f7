"""Calibration wizards: they request views or touches, give the reason, and judge the result."""
