"""Tasks of the calibration wizard by ask and tell: they request images and judge
them.
"""
