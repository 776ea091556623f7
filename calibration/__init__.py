"""From pixels to the cell frame: lens, homography and the perception that uses them."""
