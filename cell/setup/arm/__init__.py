"""Manual motion of the arm, its registration in the cell, and prediction of its
reach.
"""
