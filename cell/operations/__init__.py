"""What the commands do: fold, calibrate, replay, predict, make the standard runs."""
