"""Measurement of the strip in one image, of touch and laid fold in a sequence; whether the strip
behaved as the model says.
"""
