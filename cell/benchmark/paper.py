"""Numbers stated in the paper's text; its measured points are only in unpublished pictures."""

MEANS = {"triangular": -0.0368, "circular": 0.0627}  # m, over ten materials
WORST = {"feedback": 0.020}  # m, on every material
KNOWN_STRIP_BOUND = 0.010  # m, methods that know the strip stay under it on the same materials
REPEATABILITY = 0.001  # m, largest difference among five folds of one strip
FOLDED_HEIGHT = 0.9066  # of the bending length: the heavy elastica (Petrik and others, 2019)
