"""Reports of a run: a self-contained page; `viz` shows runs and wizards in Rerun."""
