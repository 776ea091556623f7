"""What comes before a fold: checks of machine and devices, calibration, the arm moved
by hand, strips measured.
"""
