"""Look: a bench in use, with boxes, cables and tools at different depths behind the strip."""

from drivers.twin.renderer.looks.look import Box, Cable, Look, Thing

BENCH = {"desk": (184, 172, 150), "backdrop": (206, 205, 200), "panel": (120, 110, 98)}
THINGS: tuple[Thing, ...] = (
    Box((-0.55, 1.05, 0.30), (0.40, 1.15, 0.33), (150, 128, 98)),  # a shelf on the wall
    Box((-0.30, 1.02, 0.33), (-0.16, 1.10, 0.52), (196, 150, 60)),  # a folder on it
    Box((-0.14, 1.02, 0.33), (-0.05, 1.10, 0.48), (150, 190, 205)),
    Box((0.55, 0.75, 0.00), (1.05, 0.95, 0.34), (190, 160, 118)),  # a carton behind the desk
    Box((0.66, 0.74, 0.10), (0.94, 0.75, 0.20), (236, 232, 222)),  # its label
    Box((0.02, 0.30, 0.00), (0.13, 0.40, 0.17), (170, 196, 160)),  # a tin
    Box((0.20, 0.26, 0.00), (0.33, 0.34, 0.055), (214, 120, 48)),  # a tool box
    Box((0.22, 0.28, 0.055), (0.31, 0.32, 0.068), (180, 182, 184)),  # its handle
    Box((0.445, 0.20, 0.00), (0.452, 0.21, 0.235), (198, 200, 202)),  # a steel ruler on edge
    Box((0.49, 0.36, 0.00), (0.56, 0.43, 0.12), (236, 226, 180)),  # a block of notes
    Cable(
        ((-0.2, 0.9, 0.42), (0.15, 0.88, 0.24), (0.42, 0.86, 0.21), (0.75, 0.84, 0.36)),
        0.006,
        (226, 190, 40),
    ),
    Cable(((0.36, 0.42, 0.004), (0.38, 0.40, 0.09), (0.60, 0.38, 0.16)), 0.005, (230, 230, 226)),
)

LOOK = Look("clutter", "a cluttered bench: boxes, cables, tools at different depths", BENCH, THINGS)
