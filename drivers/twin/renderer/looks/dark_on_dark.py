"""Look: a dark strip on a dark desk."""

from drivers.twin.renderer.looks.look import Look, Pattern

NIGHT = {"desk": (44, 44, 46), "backdrop": (58, 58, 62), "panel": (40, 40, 40)}

LOOK = Look(
    "dark-on-dark",
    "a dark strip on a dark desk before a dark wall",
    NIGHT,
    pattern=Pattern(own=0.5),
)
