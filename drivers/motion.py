"""Smooth commanded motion, by ruckig."""
