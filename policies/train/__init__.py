"""Training of the feedback policy: CMA-ES over folds in the rod, with domain
randomisation.
"""
