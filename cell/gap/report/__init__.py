"""The verdict for people: page, figures, sentence, overlay."""
