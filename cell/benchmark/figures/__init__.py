"""The figures of the paper, drawn from what was measured here."""
