"""Look: clutter, shadow and flicker together, as in a workshop."""

from drivers.twin.renderer.looks.arm_shadow import LAMP
from drivers.twin.renderer.looks.clutter import BENCH, THINGS
from drivers.twin.renderer.looks.flicker import MAINS
from drivers.twin.renderer.looks.look import Look
from drivers.twin.renderer.looks.two_colours import HALVES

LOOK = Look(
    "workshop",
    "clutter, the arm's shadow, flicker and a strip of two colours at once",
    BENCH,
    THINGS,
    LAMP,
    MAINS,
    HALVES,
)
