"""Standard motions for comparing simulation and measurement."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from policies.experiments.motion import Go, Motion, Part, Rest, Shake, motion
from policies.path import Path, circular

END_HEIGHT = 0.05  # of the length, height at which the paths end over the fixed edge
ARC_RADIUS = 0.15  # of the length, radius of the arc on which a path begins
TAUT = 0.40  # the same, where the strip is drawn taut at first
THIRD = 1 / 3


@dataclass(frozen=True, slots=True)
class Standard:
    """Standard motion for any strip: what it `reveals`, path `shape`, `parts`, `speed`
    [m/s].
    """

    reveals: str
    shape: Callable[[float], Path]
    parts: Sequence[Part]
    speed: float = 0.10

    def over(self, length: float, speed: float | None = None) -> Motion:
        """Motion over a strip of `length` [m], at the standard speed or at `speed`
        [m/s].
        """
        return motion(self.shape(length), self.parts, speed or self.speed)


def _tent(height: float, turn: float = ARC_RADIUS) -> Callable[[float], Path]:
    """Function from a strip's length [m] to a tent-shaped path over the strip.

    Straight up, an arc of radius `turn` to 45 degrees, an apex of `height` over the
    middle, down to the fixed edge; in units of the strip's length. It starts straight
    up because a strip drawn in before it is lifted buckles to a random side, which
    changes the entire motion.
    """
    angle = np.linspace(0.0, np.pi / 4, 46)
    arc = np.stack([1.0 - turn * (1.0 - np.cos(angle)), turn * np.sin(angle)], axis=-1)
    corners = np.concatenate([arc, [(0.5, height), (0.0, END_HEIGHT)]])
    return lambda length: Path.through(length * corners)


HIGH, LOW, MIDDLE = _tent(0.56, TAUT), _tent(0.40), _tent(0.50)
WHOLE = (Go(1.0),)

STANDARD: Mapping[str, Standard] = MappingProxyType(
    {
        "normal": Standard("everything a little", MIDDLE, WHOLE),
        "slow-low": Standard(
            "stiffness and friction between yarns", LOW, WHOLE, speed=0.05
        ),
        "fast": Standard("damping, air drag, latency", MIDDLE, WHOLE, speed=0.15),
        "high": Standard(
            "stiffness by curvature, and what gives way to a pull", HIGH, WHOLE
        ),
        "hold": Standard("creep", MIDDLE, (Go(0.45), Rest(2.0), Go(1.0))),
        "there-and-back": Standard(
            "friction between yarns", MIDDLE, (Go(0.6), Go(0.3), Go(1.0))
        ),
        "shake": Standard(
            "damping and its law",
            MIDDLE,
            (Go(0.42), Shake(0.010, frequency=2.0, cycles=4), Go(1.0)),
        ),
        "early-shake": Standard(
            "damping and stiffness near the grip",
            MIDDLE,
            (Go(0.22), Shake(0.006, frequency=3.0, cycles=6), Go(1.0)),
        ),
        "taut-lift": Standard(
            "length, stretch, grip, scale", circular, (Go(THIRD), Rest(0.5), Go(0.16))
        ),
    }
)
REFERENCE_RUN = "normal"
"""Folded first and last: the difference between the two shows a change with use."""
REPEATED_RUN = "taut-lift"
"""Folded twice: only this motion reveals slip and stretch, and an effect in a single
run cannot be confirmed by another.
"""


def standard_order(rng: np.random.Generator) -> list[str]:
    """Names of all standard runs in random order, but with REFERENCE_RUN first and
    last.
    """
    others = [*(name for name in STANDARD if name != REFERENCE_RUN), REPEATED_RUN]
    return [
        REFERENCE_RUN,
        *(others[i] for i in rng.permutation(len(others))),
        REFERENCE_RUN,
    ]
