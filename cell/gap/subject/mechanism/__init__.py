"""Mechanisms as subjects of the gap engine: any model that MuJoCo can simulate."""
