"""Self-contained HTML pages on runs and calibrations; `viz` shows runs and wizards in Rerun."""
