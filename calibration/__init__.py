"""Camera calibration: from pixels to the cell frame."""
