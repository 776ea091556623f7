"""The parts of a benchmark, each measured on its own."""
