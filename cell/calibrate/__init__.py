"""Calibration of a cell's camera by wizards or on the twin, and its check and
validity.
"""
