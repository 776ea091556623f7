"""Chain engine, the twin's plant: a strip as hinged rigid links in MuJoCo."""
