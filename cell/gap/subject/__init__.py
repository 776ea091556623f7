"""What is measured: strips and mechanisms, their runs, and how a model of them is simulated."""
