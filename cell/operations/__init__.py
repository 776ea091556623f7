"""What each command does: fold, calibrate, replay, make the standard runs, predict."""
