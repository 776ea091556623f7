"""Folding policies: fixed paths, planned paths, feedback, and their training."""
