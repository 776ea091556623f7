"""Calibration wizards: each requests views or touches, explains why, and judges the result."""
