"""Campaigns of independent computations, called parts, in processes or on Dask, with
the results kept in a journal.
"""
