"""Look: a strip that is partly as white as the wall behind it."""

from drivers.twin.renderer.looks.grey_desk import ROOM
from drivers.twin.renderer.looks.look import Look, Pattern

CHECKS = Pattern("checks", pitch=0.015, others=((226, 224, 218),))

LOOK = Look(
    "white-checks",
    "grey desk, white wall, a strip whose checks are as white as the wall",
    ROOM,
    pattern=CHECKS,
)
