"""Campaigns: parts measured in processes or on a Dask cluster, kept in a journal to resume from."""
