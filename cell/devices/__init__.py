"""The devices of a cell: which drivers are open, and the rig's known errors taken back."""
