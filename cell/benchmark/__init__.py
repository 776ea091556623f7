"""Reproduction of the paper's study: all policies over its strips, with figures and claims."""
