"""Doors for people and programs: the commands, and what `import cell` offers."""
