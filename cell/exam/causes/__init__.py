"""Causes that only the makers of exam cases know: no effect of the library is their law."""
