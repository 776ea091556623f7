"""Visualisation in Rerun: live, saved, or rebuilt from the record."""
