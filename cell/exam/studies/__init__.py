"""Studies of `cell gap`: what it finds, states and costs where the truth is known."""
