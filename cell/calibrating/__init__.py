"""Calibrating a cell: lens, homography, the check of both, by wizards or on the twin."""
