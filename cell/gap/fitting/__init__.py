"""Fits of a model to measured runs."""
