"""Learning of a cell's bias in folds, from measurements by camera and ruler."""
