"""Measurement of the strip in one image, and detection of the layer touch in a sequence."""
