"""Where a fitted model misses the runs, how much, and what to measure next."""
