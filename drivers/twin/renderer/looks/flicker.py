"""Look: a lamp on 50 Hz mains, seen by a rolling shutter."""

from drivers.twin.renderer.looks.blue_mat import ROOM
from drivers.twin.renderer.looks.look import Flicker, Look

MAINS = Flicker(mains=50.0, depth=0.30, readout=0.008)

LOOK = Look(
    "flicker", "blue mat, white wall, and light that flickers with the mains", ROOM, flicker=MAINS
)
