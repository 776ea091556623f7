"""Rendered images of the cell, drawn with OpenCV through a pinhole with radial
distortion.
"""
