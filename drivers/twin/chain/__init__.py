"""Engine that simulates the twin's strip as a chain of hinged rigid links in MuJoCo."""
