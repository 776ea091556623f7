"""Look: a strip sewn from two fabrics."""

from drivers.twin.renderer.looks.blue_mat import ROOM
from drivers.twin.renderer.looks.look import Look, Pattern

HALVES = Pattern("across", pitch=0.30, others=((150, 24, 60),))

LOOK = Look(
    "two-colours",
    "blue mat, white wall, a strip whose halves differ in colour",
    ROOM,
    pattern=HALVES,
)
