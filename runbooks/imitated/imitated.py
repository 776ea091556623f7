"""Policy `imitated`: heads as the commands of an exported LeRobot set did.

    python imitated.py SET WEIGHTS

learns from states and actions of the set in the folder SET, by least squares. Of what
was `measured` it takes the desk contact.
"""

import json
import sys
from collections.abc import Iterator
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq

from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.path import TAKEOVER_HEIGHT, Path as Line, triangular
from policies.policy import Decision, Observation
from policies.registry import Entry

AHEAD = 5  # frames over which a command gives a direction
LATE = 3  # frames from an image to the first command that it can change
DEGREE = 4  # of the polynomials
PAST = -0.2  # lengths of the strip beyond its fixed edge: the fold has ended


def taught(folder: Path) -> Iterator[tuple[Array, Array]]:
    """Yield states (n, 3) over the strip's length, gripper and desk contact, and
    commanded directions (n,) [rad] of each fold of a set, from the lift to the touch.
    """
    rows = pq.read_table(folder / "data")
    about = json.loads((folder / "meta/cell.json").read_text())
    for number, run in enumerate(about["runs"].values()):
        fold = rows.filter(pc.field("episode_index") == number)
        until = np.searchsorted(fold["stamp"], run["result.yaml"]["t_layer_touch"])
        columns = (fold[name].to_pylist() for name in ("observation.state", "action"))
        gripper, command = (np.array(column)[:until, :2] for column in columns)

        contact = fold["measured.contact"].to_numpy()[:until]
        [seen] = np.isfinite(contact).nonzero()
        contact = np.interp(np.arange(until) - LATE, seen, contact[seen])
        states = np.column_stack([gripper, contact])[:-AHEAD] / gripper[0, 0]

        steps = command[AHEAD:] - command[:-AHEAD]
        lifted = gripper[:-AHEAD, 1] > TAKEOVER_HEIGHT
        x, z = steps[lifted].T
        yield states[lifted], np.arctan2(z, x) % (2 * np.pi)


def polynomials(states: Array) -> Array:
    """Products (n, m) of up to DEGREE of the three numbers of each of `states`."""
    products = [np.ones(len(states))]
    for degree in range(1, DEGREE + 1):
        chosen = combinations_with_replacement(states.T, degree)
        products += [np.prod(numbers, axis=0) for numbers in chosen]
    return np.column_stack(products)


def train(folder: Path, weights: Path) -> None:
    """Learn from the set in `folder`; writes the file `weights`."""
    states, directions = map(np.concatenate, zip(*taught(folder), strict=True))
    centre = states.mean(axis=0)
    spreads, axes = np.linalg.eigh(np.cov(states.T))
    scale = axes / np.sqrt(spreads)
    inputs = polynomials((states - centre) @ scale)
    factors, *_ = np.linalg.lstsq(inputs, directions)
    np.savez(weights, centre=centre, scale=scale, factors=factors)
    off = np.std(inputs @ factors - directions)
    print(f"{len(states)} frames, {len(factors)} weights, {off:.3f} rad off")


class Imitated:
    """Policy that moves in learned directions at a constant speed."""

    name = "imitated"

    def __init__(self, centre: Array, scale: Array, factors: Array) -> None:
        self._centre, self._scale, self._factors = centre, scale, factors

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Prepare for `count` strips as long as `strip`, at `speed` [m/s]."""
        self._length, self._speed = strip.length, speed
        self._contact = np.full(count, strip.length)

    def lift(self) -> Line:
        """Path of the lift: the triangle's first leg."""
        return triangular(self._length)

    def decide(self, observation: Observation) -> Decision:
        """Command by the gripper, and by the newest desk contact that was seen."""
        seen = observation.contact_x
        self._contact = np.where(np.isfinite(seen), seen, self._contact)
        places = [observation.x, observation.z, self._contact]
        states = np.column_stack(places) / self._length - self._centre
        directions = polynomials(states @ self._scale) @ self._factors
        done = observation.x < PAST * self._length
        return Decision(directions, np.where(done, 0.0, self._speed), done)


def make(weights: Path | None) -> Imitated:
    """The policy with the `weights` that --checkpoint names."""
    return Imitated(**np.load(weights or "imitated.npz"))


ENTRY = Entry(50, make, learned=True)

if __name__ == "__main__":
    train(Path(sys.argv[1]), Path(sys.argv[2]))
