"""Parts of a benchmark, each measured in a process of its own."""
