"""Training of policies here or on a cluster (`cell train`), and their evaluation in
simulation.
"""
