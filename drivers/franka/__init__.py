"""The Franka Research 3 as its maker publishes it: geometry, limits, kinematics."""
