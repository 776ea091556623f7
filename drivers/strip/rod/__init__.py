"""The rod engine: an implicit planar elastic rod, batched over strips; the model of
controllers.
"""
