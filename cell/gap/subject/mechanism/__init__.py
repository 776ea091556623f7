"""Any model that MuJoCo can simulate, as a subject of the gap workflow."""
