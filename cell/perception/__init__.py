"""Measurement from camera images: strip, layer touch, laid edges, motion of the
camera.
"""
