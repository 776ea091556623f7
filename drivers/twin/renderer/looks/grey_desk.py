"""Look: a bare grey desk, as in most laboratories."""

from drivers.twin.renderer.looks.look import Look

ROOM = {"desk": (176, 178, 176), "backdrop": (222, 221, 216), "panel": (120, 118, 114)}

LOOK = Look("grey-desk", "a light grey desk before a white wall; even light", ROOM)
