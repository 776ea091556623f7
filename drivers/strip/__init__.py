"""Model of the strip that controllers may use: file, description, effects, rod
engine.
"""
