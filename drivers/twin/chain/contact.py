"""Contact and grip stiffness of a chain."""

import mujoco
import numpy as np

STEP = 0.005  # s, the longest step of the chain
TIME_CONSTANT = 2 * STEP  # s, the shortest that MuJoCo allows
SHARE = 0.9999  # of a violation's pull that a constraint exerts: sags by 1e-4 of a free fall
SOLREF = (TIME_CONSTANT, 1.0)
SOLIMP = np.array([SHARE, SHARE, 0.001, 0.5, 2.0])


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
