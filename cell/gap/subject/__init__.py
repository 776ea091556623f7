"""Subjects of the gap engine, strips and mechanisms: their runs and their
simulation.
"""
