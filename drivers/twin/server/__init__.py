"""The twin of the arm behind the robot's own network protocol.

It emulates the robot alone. Verified on loopback against the binaries of pylibfranka,
franky-control and franka-rs, never against a physical robot.
"""
