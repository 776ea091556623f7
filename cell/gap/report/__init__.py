"""Report of a verdict for people: page, figures, sentences and Rerun overlay."""
