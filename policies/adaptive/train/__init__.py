"""Training of the critic: folds with switched rises in the rod, and regression on their results."""
