"""Studies of `cell gap`: its findings, stated confidences and costs where the truth is known."""
