"""How a run ended."""

from dataclasses import dataclass

from calibration.perception.sight import SeenTouch


@dataclass(frozen=True, slots=True)
class Outcome:
    """`name` is layer_touch, path_done, calibrated or a fault's name; times from the lift [s].

    `touch` is what the images showed, `edge_offset` where the grasped edge was let go [m],
    `duration` the whole run on the cell's clock [s].
    """

    name: str
    reason: str
    exit_code: int
    touch: SeenTouch | None
    edge_offset: float | None
    duration: float
