"""Folding: one fold, batches, replay, prediction, the standard runs."""
