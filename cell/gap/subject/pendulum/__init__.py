"""Measured free swings of planar hinge chains: the second subject of the gap workflow."""
