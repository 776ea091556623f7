"""What all rooms rest on: types, errors, settings, files, the clock, and the seams."""
