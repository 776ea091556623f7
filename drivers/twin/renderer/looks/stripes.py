"""A strip with stripes across it."""

from drivers.twin.renderer.looks.grey_desk import ROOM
from drivers.twin.renderer.looks.look import Look, Pattern

STRIPES = Pattern("across", pitch=0.008, others=((24, 82, 70),))

LOOK = Look(
    "stripes", "grey desk, white wall, a strip with stripes across it", ROOM, pattern=STRIPES
)
