"""Folds and what surrounds them: single folds, batches, prediction, rehearsal, replay, films."""
