"""One page on a run, for people: report.html, readable without anything else."""
