"""Verdicts held against what was hidden."""
