"""Campaigns: parts measured on processes or a Dask cluster, kept in a journal that resumes."""
