"""Strips as subjects of the gap engine: measured folds compared with simulated ones."""
