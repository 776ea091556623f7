"""Predefined motions: the standard experiments, motions by hand, and a policy that executes one."""
