"""Base tilt: the base stands tilted, and gravity is rotated in its frame."""

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, Fields, single


def lean(fields: Fields, x: float, y: float) -> None:
    """Rotate the gravity of a model by `x` [rad] about x, then by `y` [rad] about y."""
    if x == 0.0 and y == 0.0:
        return
    gx, gy, gz = (float(g) for g in fields["opt.gravity"])
    gy, gz = gy * np.cos(x) - gz * np.sin(x), gy * np.sin(x) + gz * np.cos(x)
    gx, gz = gx * np.cos(y) + gz * np.sin(y), gz * np.cos(y) - gx * np.sin(y)
    fields["opt.gravity"][:] = gx, gy, gz


EFFECT = Effect(
    name="base_tilt",
    sentence="the base stands tilted",
    of="rig",
    source="rotation of gravity about x, then y",
    parameters=lambda _: tuple(
        p for axis in "xy" for p in single(axis, "rad", 0.002, signed=True, high=150.0)
    ),
    edit=lambda _, values, fields: lean(fields, *map(float, values)),
    revealed_by="hold still in several poses, with a level on the base",
)
