"""The report of a run: report.html, self-contained; `viz` shows runs and wizards in Rerun."""
