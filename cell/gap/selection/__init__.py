"""Which effects a model needs: screening, search, comparison on held-out runs."""
