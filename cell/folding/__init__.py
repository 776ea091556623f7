"""Folds of strips: single ones and batches, prediction, rehearsal, replay, measurement
of films.
"""
