"""Feedback policy of the paper: heading phi from gripper x, z and desk contact x by a
network.
"""

import json
import math
from pathlib import Path as FilePath
from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field, NonNegativeInt

from drivers.base.errors import ConfigurationError
from drivers.base.files import write_file
from drivers.base.readers import MEGABYTE, read_json
from drivers.base.settings import Settings, VersionedFile, parse
from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.path import Path, triangular
from policies.policy import Decision, Observation

COMMITTED = FilePath(__file__).with_name("weights") / "feedback.json"

INPUTS = 3
HIDDEN_UNITS = 20
WEIGHT_COUNT = (INPUTS + 1) * HIDDEN_UNITS + HIDDEN_UNITS + 1

# Over the strip's length: a typical state, and the directions in which states spread
# around it, so that a unit change of any weight means about as much as one of another.
INPUT_CENTRE = (0.57, 0.40, 0.56)
INPUT_SPREAD = ((0.16, 0.0, 0.0), (0.0, 0.11, 0.0), (0.04, -0.08, 0.02))
WHITEN = np.linalg.inv(np.array(INPUT_SPREAD)).T

# Over the strip's length. Below LOWEST_HEIGHT the gripper does not go down, above LOFT
# not up, and farther than NEARLY_TAUT from the fixed edge not outward. Beyond PAST the
# fold has ended.
LOWEST_HEIGHT = 0.05
LOFT = 0.75
NEARLY_TAUT = 0.95
PAST = -0.20


class HeadingNetwork:
    """Network with one hidden layer of 20 tanh units, for p candidate weights at once.

    `weights` (p, WEIGHT_COUNT): per unit three input weights, then the hidden biases,
    the output weights and the output bias.
    """

    def __init__(self, weights: Array) -> None:
        cut = np.cumsum([INPUTS * HIDDEN_UNITS, HIDDEN_UNITS, HIDDEN_UNITS])
        first, self._first_bias, self._last, self._last_bias = np.split(
            np.atleast_2d(weights), cut, axis=1
        )
        self._first = first.reshape(-1, HIDDEN_UNITS, INPUTS)

    def __call__(self, state: Array) -> Array:
        """Directions (p, m) [rad] for states (p, m, 3), lengths over the strip's
        length.
        """
        whitened = np.einsum("pmi,ij->pmj", state - INPUT_CENTRE, WHITEN)
        # einsum, because rounding by BLAS depends on its threads and on the size of the
        # batch
        drive = (
            np.einsum("pmj,phj->pmh", whitened, self._first) + self._first_bias[:, None]
        )
        turn = np.einsum("pmh,ph->pm", np.tanh(drive), self._last) + self._last_bias
        directions: Array = math.pi + 0.5 * math.pi * turn
        return directions


class Feedback:
    """Feedback policy of Petrik and Kyrki (2019), with `weights` (p, WEIGHT_COUNT) of p
    candidates.

    The speed is constant. The direction always has a component toward the fixed edge,
    so that every fold ends in a touch or past the edge.
    """

    name = "feedback"

    def __init__(self, weights: Array) -> None:
        self._network = HeadingNetwork(weights)
        self._groups = len(np.atleast_2d(weights))
        self._length = 1.0
        self._speed = 0.0
        self._contact: Array = np.zeros(0)

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Prepare for `count` strips, a multiple of the number p of candidate
        weights.
        """
        self._length = strip.length
        self._speed = speed
        self._contact = np.full(count, np.nan)

    def lift(self) -> Path:
        """Path of the lift: the triangle, of which only the first leg is used."""
        return triangular(self._length)

    def decide(self, observation: Observation) -> Decision:
        """Command headings by the network, from the gripper and the newest visible desk
        contact.
        """
        seen = np.isfinite(observation.contact_x)
        self._contact = np.where(seen, observation.contact_x, self._contact)
        state = np.stack([observation.x, observation.z, self._contact], axis=-1)
        state = state / self._length

        headings = self._network(state.reshape(self._groups, -1, 3)).reshape(-1)
        blind = np.isnan(self._contact)
        direction = np.where(blind, 0.75 * math.pi, headings)
        done = state[:, 0] < PAST
        return Decision(
            direction=_limit_directions(direction, state[:, 0], state[:, 1]),
            speed=np.where(done, 0.0, self._speed),
            done=done,
        )


def _limit_directions(direction: Array, x: Array, z: Array) -> Array:
    """Clip `direction` (n,) [rad] by bounds of height and distance; `x`, `z` (n,) over
    length.
    """
    # heading at a constant distance from the edge
    along_circle = np.arctan2(z, x) + 0.5 * math.pi
    is_taut = np.hypot(x, z) > NEARLY_TAUT
    low = np.where(is_taut, along_circle, 0.5 * math.pi)
    low = np.where(z > LOFT, np.maximum(low, math.pi), low)
    high = np.where(z < LOWEST_HEIGHT, math.pi, 1.5 * math.pi)
    return np.clip(direction, np.minimum(low, high), high)


class Training(Settings):
    """Origin of a feedback network's weights: seed, generations and folds of their
    training.
    """

    model_config = ConfigDict(extra="ignore")

    seed: int
    generations: NonNegativeInt
    folds: NonNegativeInt


class Checkpoint(VersionedFile):
    """Content of a checkpoint file: weights of the feedback network, and their
    training.
    """

    model_config = ConfigDict(extra="ignore")

    policy: Literal["feedback"]
    weights: Annotated[
        tuple[float, ...], Field(min_length=WEIGHT_COUNT, max_length=WEIGHT_COUNT)
    ]
    training: Training


def load_checkpoint(path: FilePath) -> Checkpoint:
    """Read the checkpoint at `path`; ConfigurationError where it is missing or
    broken.
    """
    try:
        return parse(read_json(path, MEGABYTE), Checkpoint, str(path))
    except ConfigurationError as error:
        raise ConfigurationError(
            f"{error}; name another checkpoint or train one"
        ) from None


def save_checkpoint(path: FilePath, checkpoint: Checkpoint) -> None:
    """Write `checkpoint` to `path` atomically; ConfigurationError where that fails."""
    content = checkpoint.model_dump(by_alias=True)
    write_file(
        path, (json.dumps(content, indent=1) + "\n"), "make room or name another folder"
    )


def load_feedback(path: FilePath | None = None) -> Feedback:
    """Policy `feedback` with the weights of the checkpoint at `path`, or of the
    committed one.
    """
    return Feedback(np.array(load_checkpoint(path or COMMITTED).weights))
