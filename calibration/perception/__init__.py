"""What one image says of the strip, and what a sequence of them says of the touch."""
