"""Image processing: measures strip, layer touch and laid fold, and checks the strip model."""
