"""Simulation of one strip along a gripper path by any engine."""

import numpy as np

from drivers.strip.engine import Observables, Stepper, StripMotion
from drivers.strip.model import StripModel
from drivers.strip.observation import true_path
from drivers.types import Array


def simulate(
    engine: Stepper,
    model: StripModel,
    t: Array,
    poses: Array,
    *,
    dt: float = 0.005,
    shapes: bool = False,
) -> StripMotion:
    """Simulate one strip along a gripper path of times `t` (m,) [s] and `poses` (m, 3).

    Stops at layer_touch. The path is the reported one; the true one follows from the model's rig.
    """
    t, poses = true_path(model.rig, t, poses)
    engine.reset([model])
    elapsed = np.arange(dt, t[-1] - t[0] + 0.5 * dt, dt)
    path = np.stack([np.interp(elapsed + t[0], t, poses[:, c]) for c in range(3)], axis=1)
    seen: list[Observables] = []
    curves: list[Array] = []
    for pose in path:
        seen.append(engine.step(pose[None], dt))
        if shapes:
            curves.append(engine.shapes()[0].copy())
        if seen[-1].touch[0] is not None:
            break
    nodes = engine.shapes().shape[1]
    return StripMotion(
        t=elapsed[: len(seen)] + t[0],
        poses=path[: len(seen)],
        contact_x=np.array([step.contact_x[0] for step in seen]),
        tip=np.array([step.tip[0] for step in seen]),
        holding_force=np.array([step.holding_force[0] for step in seen]),
        grip_force=np.array([step.grip_force[0] for step in seen]).reshape(-1, 2),
        shapes=np.array(curves) if curves else np.empty((0, nodes, 2)),
        touch=seen[-1].touch[0] if seen else None,
    )
