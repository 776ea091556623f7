"""Studies of the cell: measurements over many cases, a file a study, locally or on a cluster."""
