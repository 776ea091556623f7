"""Devices of the cell: protocols, the twin that stands in for hardware, the strip's
model.
"""
