"""Mechanisms as subjects of the gap workflow: any model that MuJoCo can simulate."""
