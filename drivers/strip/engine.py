"""Protocol of a strip engine that steps a batch, and simulation of one motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drivers.strip.grip_path import true_path
from drivers.strip.model import StripModel
from drivers.strip.shape import Touch
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Observables:
    """Observable quantities of n strips at one instant `time` [s].

    `contact_x` (n,) [m]; `tip` (n, 2) [m], the fold's rightmost point; `holding_force` (n,) [N],
    the force along x that the fixed edge exerts on the strip, negative when taut; `grip_force`
    (n, 2) [N] along x and z, that of the strip on the grip; `touch` of each strip, constant once
    set.
    """

    time: float
    contact_x: Array
    tip: Array
    holding_force: Array
    grip_force: Array
    touch: tuple[Touch | None, ...]


class Stepper(Protocol):
    """An engine that simulates n strips at once, each held by its own gripper."""

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the strips flat and at rest, gripped at (stated length, 0) with pitch 0, at time 0.

        Raises Unsupported for a part of a model that the engine cannot represent.
        """

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (n, 3) of x, z, pitch at the step's end.

        Raises SimulationNotFinite when the simulation diverges.
        """

    def shapes(self) -> Array:
        """Midlines (n, nodes, 2) [m] from the fixed to the grasped edge, both included."""

    def arc(self) -> Array:
        """Arc lengths of the nodes (n, nodes) [m], unstretched, from the fixed edge."""


@dataclass(frozen=True, slots=True)
class StripMotion:
    """Simulated motion of one strip: observables at k times, shapes and the layer touch, if any.

    Times (k,), gripper poses (k, 3), contact_x (k,), tip (k, 2), holding_force (k,), grip_force
    (k, 2), shapes (k, nodes, 2) or (0, nodes, 2). All values are true ones over the true desk;
    `observation` converts them to measured ones.
    """

    t: Array
    poses: Array
    contact_x: Array
    tip: Array
    holding_force: Array
    grip_force: Array
    shapes: Array
    touch: Touch | None


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
