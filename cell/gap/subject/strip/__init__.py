"""The strip as a subject of the gap workflow: measured folds against the rod."""
