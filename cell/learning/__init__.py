"""Learning of a cell's bias in folds, from later measurements by camera and ruler."""
