"""Selection of the effects that a model needs: screening, search, cross-validated
comparison.
"""
