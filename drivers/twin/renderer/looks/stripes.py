"""Look: a strip with stripes across it."""

from drivers.twin.renderer.looks.blue_mat import ROOM
from drivers.twin.renderer.looks.look import Look, Pattern

STRIPES = Pattern("across", pitch=0.008, others=((24, 82, 70),))

LOOK = Look(
    "stripes", "blue mat, white wall, a strip with stripes across it", ROOM, pattern=STRIPES
)
