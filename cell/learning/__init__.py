"""Learning of the systematic error (bias) of a cell's folds, from camera and ruler."""
