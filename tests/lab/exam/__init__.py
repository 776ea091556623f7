"""Exam of `cell gap`: hides known causes in simulated strips and scores its
diagnoses.
"""
