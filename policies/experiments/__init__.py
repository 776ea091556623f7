"""Predefined motions: the standard experiments, motions by hand, a policy that executes one."""
