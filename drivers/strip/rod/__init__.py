"""The rod: an implicit planar elastic rod, many strips side by side, the model of the cell."""
