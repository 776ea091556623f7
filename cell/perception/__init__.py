"""Measures the strip in one image, touch and laid fold in a sequence, and if the model holds."""
