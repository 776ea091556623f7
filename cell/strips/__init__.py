"""Measurement of strips, and strip files made from it."""
