"""`cell train`: training here or on a cluster, and evaluation on both engines."""
