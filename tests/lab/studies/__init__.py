"""Studies of the cell: measurements over many cases, one module a study, here or on a
cluster.
"""
