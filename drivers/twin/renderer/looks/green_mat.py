"""Look: the default cell with a green mat."""

from drivers.twin.renderer.looks.look import Look

LOOK = Look("green-mat", "a green mat before a green backdrop, as for chroma keying; even light")
