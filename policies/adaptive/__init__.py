"""Folding of unmeasured strips: a network predicts the displacement, and the path
corrects it.
"""
