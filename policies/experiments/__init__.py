"""Predefined motions: standard experiments, motions by hand, and a policy that executes
them.
"""
