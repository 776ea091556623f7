"""Tools that several studies measure with."""
