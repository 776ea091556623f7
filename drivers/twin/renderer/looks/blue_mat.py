"""Look: a blue antistatic mat, which preflight asks the operator to use for grey strips."""

from drivers.twin.renderer.looks.look import Look

ROOM = {"desk": (150, 172, 200), "backdrop": (222, 221, 216), "panel": (120, 118, 114)}

LOOK = Look("blue-mat", "a pale blue antistatic mat before a white wall; even light", ROOM)
