"""Protocol of a strip engine, which simulates a batch of strips, and the engine's
results.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from drivers.base.geometry import arc_lengths, running_sums
from drivers.base.types import Array
from drivers.strip.model import StripModel


@dataclass(frozen=True, slots=True)
class Touch:
    """First contact of a folding strip's two layers: `time` [s], place `x` [m], and arc
    lengths [m] from there to the grasped and the fixed edge.

    `extension` [m] is how much longer than `to_grasped` the upper layer is up to the
    grip, because it is stretched or slid out of the grip. The grasped edge is to come
    to lie at x = `goal` [m], on the fixed edge where the strip is folded in half.
    """

    time: float
    x: float
    to_grasped: float
    to_fixed: float
    extension: float = 0.0
    goal: float = 0.0

    @classmethod
    def in_shape(
        cls, time: float, x: float, s: float, arc: Array, midline: Array
    ) -> Self:
        """Layer touch at `time` [s], at `x` [m] and arc length `s` [m] of a strip whose
        midline (n, 2) [m] has its nodes at `arc` (n,) [m].
        """
        along = arc_lengths(midline)
        at_rest = float(arc[-1]) - s
        extension = float(along[-1] - np.interp(s, arc, along)) - at_rest
        return cls(
            time=time,
            x=x,
            to_grasped=at_rest,
            to_fixed=x - float(midline[0, 0]),
            extension=extension,
        )

    @property
    def displacement(self) -> float:
        """Distance d = l1 - l2 [m] by which the grasped edge will miss `goal`, with l1
        and l2 the lengths from the touch to the grasped and the fixed edge.
        """
        return self.to_grasped - (self.to_fixed - self.goal)


@dataclass(frozen=True, slots=True)
class Observables:
    """Observable quantities of n strips after a step.

    `contact_x` (n,) [m]; `tip` (n, 2) [m], the fold's rightmost point; `holding_force`
    (n,) [N], the force along x that the fixed edge exerts on the strip, negative when
    taut; `grip_force` (n, 2) [N] along x and z, that of the strip on the grip; `touch`
    of each strip, constant once set.
    """

    contact_x: Array
    tip: Array
    holding_force: Array
    grip_force: Array
    touch: tuple[Touch | None, ...]


class Stepper(Protocol):
    """Protocol of an engine that simulates n strips at once, each held by its own
    gripper.
    """

    def reset(self, models: Sequence[StripModel]) -> None:
        """Lay the strips flat and at rest at time 0, each gripped at x = its stated
        length, z = 0, pitch 0.

        Raises Unsupported for a part of a model that the engine cannot represent.
        """

    def step(self, poses: Array, dt: float) -> Observables:
        """Advance by `dt` [s] to gripper `poses` (n, 3) [m, m, rad] at the step's end.

        Raises SimulationNotFinite when the simulation diverges.
        """

    def shapes(self) -> Array:
        """Midlines (n, nodes, 2) [m] of all n strips, from the fixed to the grasped
        edge.
        """

    def arc(self) -> Array:
        """Unstretched arc lengths (n, nodes) [m] of the strips' nodes, from the fixed
        edge.
        """


@dataclass(frozen=True, slots=True)
class StripMotion:
    """Simulated motion of one strip: its observables at k times, its shapes, and the
    touch of its layers, None without one.

    Times (k,), gripper poses (k, 3), contact_x (k,), holding_force (k,), grip_force (k,
    2), shapes (k, nodes, 2) or (0, nodes, 2). Values are true, over the true desk;
    `observation` converts them to measured ones.
    """

    t: Array
    poses: Array
    contact_x: Array
    holding_force: Array
    grip_force: Array
    shapes: Array
    touch: Touch | None


def graded_nodes(length: float, pieces: int, fraction: float, finest: float) -> Array:
    """Arc lengths (pieces + 1,) [m] of a strip's nodes: equally spaced, but closer near
    the grip.

    Over the last `fraction` of the segments their length shrinks to `finest` times the
    others'. Near the grip a taut strip bends within sqrt(EI / T), a millimetre or two;
    where it leaves the desk depends on the length of that bend.
    """
    before_grip = (pieces - 0.5 - np.arange(pieces)) / pieces
    spans = np.minimum(1.0, finest ** (1.0 - before_grip / fraction))
    arc = running_sums(spans)
    nodes: Array = arc * (length / arc[-1])
    return nodes
