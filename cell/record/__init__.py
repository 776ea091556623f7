"""The record of a run: a folder that survives the death of the process that writes it."""
