"""The view in Rerun: what a run shows, live, saved, or rebuilt from its record."""
