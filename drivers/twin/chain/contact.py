"""Contact and grip stiffness of a chain."""

import mujoco
import numpy as np

LONGEST_STEP = 0.005  # s, the longest step of the chain
TIME_CONSTANT = 2 * LONGEST_STEP  # s, the shortest that MuJoCo allows
# of a violation's pull that a constraint exerts: sags by 1e-4 of a free fall
CONSTRAINT_SHARE = 0.9999
SOLREF = (TIME_CONSTANT, 1.0)
SOLIMP = np.array([CONSTRAINT_SHARE, CONSTRAINT_SHARE, 0.001, 0.5, 2.0])


def sag(acceleration: float) -> float:
    """Depth [m] to which a body under `acceleration` [m/s^2] sinks into a contact at rest.

    Over it a strip starts at rest. Over a desk without it the strip would fall freely for a step,
    to a kink of 0.1 mm at its fixed edge, and under the push of a lift the strip would buckle there
    instead of at the grip.
    """
    return (1.0 - CONSTRAINT_SHARE) * acceleration * TIME_CONSTANT**2


def solid(body: mujoco.MjsBody, contype: int, conaffinity: int) -> mujoco.MjsGeom:
    """A massless, frictionless sphere on `body` whose stiffness determines its contacts."""
    return body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        contype=contype,
        conaffinity=conaffinity,
        condim=1,
        priority=1,
        solref=SOLREF,
        solimp=SOLIMP,
        mass=0.0,
    )
