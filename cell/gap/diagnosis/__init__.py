"""Diagnosis of a fit: where the model misses the runs, how much, and what to measure
next.
"""
