"""The cases of an exam: drawn at random, scaled to their strength, with sealed keys."""
