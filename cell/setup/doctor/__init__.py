"""Checks of machine, files and devices that decide whether a robot may move."""
