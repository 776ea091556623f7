"""Look: one strong lamp beside the camera, so that the arm casts a shadow."""

from drivers.twin.renderer.looks.blue_mat import ROOM
from drivers.twin.renderer.looks.look import Lamp, Look

LAMP = Lamp(place=(0.10, -2.0, 0.80), size=0.04, share=0.35)

LOOK = Look(
    "arm-shadow", "blue mat, white wall, and the arm's shadow moving over both", ROOM, lamp=LAMP
)
