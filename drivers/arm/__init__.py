"""A Franka arm through its own network interface: a process that owns the 1 kHz loop, and hand."""
