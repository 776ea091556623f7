"""Figures of the paper, drawn from the benchmark's results."""
