"""Devices of a cell: the selected drivers, with known errors of the rig compensated."""
