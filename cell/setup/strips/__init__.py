"""Measurement of strips on photographs, and strip files made from it."""
