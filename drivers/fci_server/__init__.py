"""Emulation of the robot's own network protocol by the twin's arm.

It emulates the robot without a strip. Verified on loopback against the binaries of pylibfranka,
franky-control and franka-rs, never against a physical robot.
"""
