"""Published geometry, limits, kinematics and hand protocol of the Franka Research 3."""
