"""Folding of an unmeasured strip: a critic predicts d, and the path is moved until d is 0."""
