"""Training of the critic: simulated folds whose rise changes at random, and
regression.
"""
