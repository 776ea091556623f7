"""Campaigns of independent computations (parts) in processes or on Dask, kept in a
journal.
"""
