"""Calibration of a cell: lens, homography and their check, by wizards or on the twin."""
