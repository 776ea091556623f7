"""Reproduction of the paper's study: every policy over strips and range, figures, claims."""
