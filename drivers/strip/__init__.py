"""The strip as the controller may know it: file, description, effects, engines' seam."""
