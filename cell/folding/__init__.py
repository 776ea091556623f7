"""Commands around a fold: one fold, batches, prediction, replay, the standard runs."""
