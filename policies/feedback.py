"""The paper's feedback policy: heading phi from gripper x, z and desk_contact x."""

import math
from pathlib import Path as FilePath

import numpy as np

from drivers.strip.file import StripFile
from drivers.types import Array
from policies.checkpoint import load_checkpoint
from policies.network import HeadingNetwork
from policies.path import Path, triangular
from policies.policy import Decision, Observation

COMMITTED = FilePath(__file__).with_name("weights") / "feedback.json"

# Over the strip's length. Below LOWEST_HEIGHT the gripper does not go down, above LOFT not up, and
# farther than NEARLY_TAUT from the fixed edge not outward. Beyond PAST the fold has ended.
LOWEST_HEIGHT = 0.05
LOFT = 0.75
NEARLY_TAUT = 0.95
PAST = -0.20


class Feedback:
    """Policy of the paper's network; `weights` (p, WEIGHT_COUNT) drive p equal groups of the batch.

    Speed and pitch are constant. The direction always has a component toward the fixed edge, so
    that every fold ends in a touch or past the edge.
    """

    name = "feedback"

    def __init__(self, weights: Array) -> None:
        self._network = HeadingNetwork(weights)
        self._groups = len(np.atleast_2d(weights))
        self._length = 1.0
        self._speed = 0.0
        self._contact: Array = np.zeros(0)

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Prepare for `count` strips, a multiple of the number of candidate weights."""
        self._length = strip.length
        self._speed = speed
        self._contact = np.full(count, np.nan)

    def lift(self) -> Path:
        """Path of the lift: the triangle, of which only the first leg is used."""
        return triangular(self._length)

    def decide(self, observation: Observation) -> Decision:
        """Decide headings by the network, from the gripper and the newest visible desk contact."""
        seen = np.isfinite(observation.contact_x)
        self._contact = np.where(seen, observation.contact_x, self._contact)
        state = np.stack([observation.x, observation.z, self._contact], axis=-1) / self._length
        blind = np.isnan(self._contact)
        direction = np.where(blind, 0.75 * math.pi, self._direction(state))
        done = state[:, 0] < PAST
        return Decision(
            direction=limit_directions(direction, state[:, 0], state[:, 1]),
            speed=np.where(done, 0.0, self._speed),
            pitch_rate=np.zeros(len(direction)),
            done=done,
        )

    def _direction(self, state: Array) -> Array:
        return self._network(state.reshape(self._groups, -1, 3)).reshape(-1)


def limit_directions(direction: Array, x: Array, z: Array) -> Array:
    """Directions (n,) [rad] clipped to bounds of height and distance; `x`, `z` (n,) over length."""
    along_circle = np.arctan2(z, x) + 0.5 * math.pi  # heading at a constant distance from the edge
    low = np.where(np.hypot(x, z) > NEARLY_TAUT, along_circle, 0.5 * math.pi)
    low = np.where(z > LOFT, np.maximum(low, math.pi), low)
    high = np.where(z < LOWEST_HEIGHT, math.pi, 1.5 * math.pi)
    return np.asarray(np.clip(direction, np.minimum(low, high), high))


def load_feedback(path: FilePath | None = None) -> Feedback:
    """The policy with the weights of the checkpoint at `path`, or the committed one."""
    return Feedback(np.array(load_checkpoint(path or COMMITTED).weights))
