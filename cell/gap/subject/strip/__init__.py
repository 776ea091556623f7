"""Strip as a subject of the gap workflow: measured folds compared with the rod model."""
