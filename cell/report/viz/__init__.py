"""Recordings of runs and wizards for the viewer Rerun: live, saved, or from the
record.
"""
