"""Published geometry, limits and kinematics of the Franka Research 3."""
