"""Record of a run: a folder that survives a crash of the process that writes it."""
