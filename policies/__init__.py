"""What decides where the gripper goes: paths, feedback, and their training."""
