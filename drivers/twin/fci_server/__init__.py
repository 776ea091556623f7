"""Emulation of a robot on the network, which speaks the protocol of the real one (FCI).

It emulates the robot without a strip. Verified on loopback against the binaries of
pylibfranka, franky-control and franka-rs, never against a physical robot.
"""
