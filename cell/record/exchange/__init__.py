"""Runs that other programs measured: read from their tables, written as run folders."""
