"""What is measured: strips and pendulums, their runs, and how a model of them is simulated."""
