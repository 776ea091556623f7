"""The bias of a cell's folds, learned from what its camera and a ruler measured afterwards."""
