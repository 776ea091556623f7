"""Camera calibration and perception: from pixels to the cell frame."""
