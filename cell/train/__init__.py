"""`cell train`: the feedback policy trained here or on a cluster, and judged on both engines."""
