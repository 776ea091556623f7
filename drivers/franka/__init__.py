"""Driver of a Franka arm and hand over the Franka Control Interface, its 1 kHz loop a
process; published geometry, limits and kinematics of the Franka Research 3.
"""
