"""Look: a chequered strip."""

from drivers.twin.renderer.looks.blue_mat import ROOM
from drivers.twin.renderer.looks.look import Look, Pattern

CHECKS = Pattern("checks", pitch=0.012, others=((40, 48, 96), (150, 24, 60)))

LOOK = Look(
    "checks", "blue mat, white wall, a strip in checks of three colours", ROOM, pattern=CHECKS
)
