"""Orchestration of a run: control loop, monitors, and a generator of commands per
state.
"""
