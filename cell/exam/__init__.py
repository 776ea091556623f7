"""The exam of the gap workflow: cases with a hidden cause, a sealed key, and the scores."""
