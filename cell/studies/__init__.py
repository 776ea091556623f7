"""Studies: what is measured of the cell, one file a study, on one machine or a cluster."""
