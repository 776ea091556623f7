"""Finds and names effects that the simulation lacks, adds them, and shows that the gap
shrinks.
"""
