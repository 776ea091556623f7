"""What really happened on the twin. Scoring reads it, and nothing else."""

from dataclasses import dataclass

from drivers.strip.shape import Touch
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Truth:
    """The world at each strip step since the grasp: times `t` (k,) [s of the run].

    `contact_x` (k,) [m]; `tip` (k, 2) [m], the fold's rightmost point; `gripper` (k, 3) and
    `edge` (k, 3), poses of the fingers and of the strip's grasped edge; `shapes` (k, n, 2) [m],
    midlines at arc lengths `arc` (n,) [m]; `holding_force` (k,) [N]. `edge_offset` [m] is how far
    the grasped edge lies beyond the fixed one at the end, with the sign of d.
    """

    t: Array
    contact_x: Array
    tip: Array
    gripper: Array
    edge: Array
    shapes: Array
    arc: Array
    holding_force: Array
    touch: Touch | None
    edge_offset: float
