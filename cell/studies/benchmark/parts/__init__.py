"""Parts of a benchmark, each measured on its own."""
