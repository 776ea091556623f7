"""Where simulation and measurement disagree: found, named, added, shown to shrink."""
