"""The arm by hand, its registration in the cell, and whether it reaches a fold."""
