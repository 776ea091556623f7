"""Scoring of verdicts against the hidden causes."""
