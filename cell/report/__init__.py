"""Self-contained HTML pages on runs and calibrations, and recordings for the viewer
Rerun.
"""
