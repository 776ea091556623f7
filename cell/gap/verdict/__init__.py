"""The verdict of an investigation: findings, decision, output and acceptance."""
