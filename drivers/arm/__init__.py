"""Driver of a Franka arm and hand over the Franka Control Interface, with a process for the 1 kHz
loop.
"""
