"""Cases of an exam: random draws, scaling to a strength, and sealed answer keys."""
