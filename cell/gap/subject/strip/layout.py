"""Layout of a run's samples: which readings are averaged into which."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.strip.phases import ZONES, phases, zones
from cell.gap.subject.strip.runs import Measured
from cell.gap.subject.subject import Samples, Words
from drivers.types import Array

SAMPLE_TIME = 0.3  # s of one sample
BRIEF = 0.05  # s of one of the force, in which a shake shows when it was reported
TOUCH_TIME = 0.03  # s, noise of the time of a touch where nobody states it
# m of travel before which a strip just lifted shows more of its grip than of itself
GRIP_TRAVEL = 0.15
SNAP = 0.15  # s before the touch in which any model is off
FEWEST_POINTS = 4  # points of a profile's sample
EVENT = ("touch_time", "touch_x", "displacement")


@dataclass(frozen=True, slots=True)
class Floors:
    """Errors of every model of a strip, root mean square of one sample: [m], [s], [N].

    Of the `force`, rod and chain differ by a tenth of a millinewton; the coarse rod errs by more
    where a gripper jerks.
    """

    profile: float = 0.00025
    contact_x: float = 0.0006
    displacement: float = 0.001
    touch_time: float = 0.02
    force: float = 0.0001


@dataclass(frozen=True, slots=True)
class Part:
    """Readings of one channel by sample: `order` (n,) sorts them, `edges` (k + 1,) parts them.

    Of each sample (k,): `phase`, `zone`, mean time `t` [s]; `sigma` is that of a reading.
    """

    order: NDArray[np.int64]
    edges: NDArray[np.int64]
    phase: Words
    zone: Words
    t: Array
    sigma: float

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True)
class Layout:
    """A run's samples: of profile, contact, force along x and z, then of the touch if any."""

    profile: Part
    contact: Part
    force: tuple[Part, Part]
    samples: Samples


def layout(run: Measured, length: float, floors: Floors) -> Layout:
    """Samples of `run`, a fold of a strip of `length` [m]."""
    images, sigma = run.images, run.sigma
    profile = _part(
        run, images.stamps[images.image], zones(images.s, length), sigma.profile, FEWEST_POINTS
    )
    apart = _is_buckled(run, length)
    contact = _part(run, run.contact_t, zones(run.contact_x, length), sigma.contact_x, 1, apart)
    force = _force_part(run, length, 0), _force_part(run, length, 1)
    columns = [
        *_columns(profile, "profile", floors.profile, by_zone=True),
        *_columns(contact, "contact_x", floors.contact_x),
        *_columns(force[0], "force", floors.force),
        *_columns(force[1], "force", floors.force),
        *_touch_column(run, floors),
    ]
    return Layout(profile, contact, force, _samples(columns))


def _force_part(run: Measured, length: float, axis: int) -> Part:
    """Part of the force along one axis; none where the run states no noise for it."""
    reported = run.force_t if run.has_force else np.empty(0)
    unknown = np.isnan(run.force[: len(reported), axis])
    grasped = zones(np.full(len(reported), length), length)
    return _part(run, reported, grasped, run.sigma.force or 0.0, 1, unknown, BRIEF)


def _is_buckled(run: Measured, length: float) -> NDArray[np.bool_]:
    """Mask of contacts (k,) beside the fixed edge while the other end is still being lifted.

    A soft strip that is pushed along the desk buckles there or not, by chance.
    """
    return np.asarray((run.contact_x < length / 3) & (phases(run, run.contact_t) == "lift"))


def _part(
    run: Measured,
    t: Array,
    zone: Words,
    sigma: float,
    fewest: int,
    left_out: NDArray[np.bool_] | None = None,
    span: float = SAMPLE_TIME,
) -> Part:
    """Readings at `t` (n,) in `zone` (n,) grouped by zone, phase and time; the masked left out."""
    phase = phases(run, t)
    labels = list(dict.fromkeys(phase))
    numbers = np.array([labels.index(word) for word in phase], dtype=np.int64)
    place = np.array([ZONES.index(word) for word in zone], dtype=np.int64)
    slot = np.floor(t / span).astype(np.int64)
    key = (place * 100_000 + slot) * 10 + numbers
    masked = np.zeros(len(t), dtype=bool) if left_out is None else left_out
    used = np.flatnonzero(_is_compared(run, t) & ~masked)
    order = used[np.argsort(key[used], kind="stable")]
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    rows = [order[a : a + n] for a, n in zip(first, count, strict=True) if n >= fewest]
    return Part(
        order=np.concatenate(rows) if rows else np.empty(0, dtype=np.int64),
        edges=np.cumsum([0, *(len(row) for row in rows)]),
        phase=phase[[row[0] for row in rows]],
        zone=zone[[row[0] for row in rows]],
        t=np.array([t[row].mean() for row in rows]),
        sigma=sigma,
    )


def _is_compared(run: Measured, t: Array) -> NDArray[np.bool_]:
    """Mask of times (n,) that are compared: after the lift's start, before snap and touch."""
    lifted = run.hanging | (np.interp(t, run.t, run.travel) >= GRIP_TRAVEL)
    end = run.end - (SNAP if run.touch is not None else 0.0)
    return np.asarray(lifted & (t >= run.t[0]) & (t < end))


@dataclass(frozen=True, slots=True)
class _Column:
    """Readings of one series, sample by sample."""

    channel: str
    quantity: str
    phase: Words
    zone: Words
    t: Array
    noise: Array
    reading: float
    floor: float


def _columns(part: Part, channel: str, floor: float, *, by_zone: bool = False) -> list[_Column]:
    """The series of `part`: one, or one a zone."""
    noise = part.sigma / np.sqrt(np.maximum(np.diff(part.edges), 1))
    found = []
    for rows in [part.zone == z for z in ZONES] if by_zone else [np.ones(len(part), dtype=bool)]:
        place = part.phase[rows], part.zone[rows], part.t[rows], noise[rows]
        found.append(_Column(channel, channel, *place, part.sigma, floor))
    return found


def _touch_column(run: Measured, floors: Floors) -> list[_Column]:
    """The touch as a series: its time, mean distance from both edges, and displacement.

    l1 and l2 are measured alike, so that their difference and their mean err independently.
    """
    if run.touch is None:
        return []
    place = np.array(["touch"]), np.array(["middle"]), np.array([run.touch.time])
    gap = run.sigma.displacement
    time = run.sigma.touch_time or TOUCH_TIME
    sizes = (
        (time, floors.touch_time),
        (gap / 2, floors.displacement / 2),
        (gap, floors.displacement),
    )
    return [
        _Column("layer_touch", quantity, *place, np.array([sigma]), sigma, floor)
        for quantity, (sigma, floor) in zip(EVENT, sizes, strict=True)
    ]


def _samples(columns: Sequence[_Column]) -> Samples:
    """Samples of the series `columns`, one after the other."""
    sizes = [len(c.t) for c in columns]

    def words(name: str) -> Words:
        return np.concatenate(
            [np.full(n, getattr(c, name)) for c, n in zip(columns, sizes, strict=True)]
        )

    def numbers(name: str) -> Array:
        return np.concatenate(
            [np.broadcast_to(getattr(c, name), n) for c, n in zip(columns, sizes, strict=True)]
        )

    return Samples(
        channel=words("channel"),
        phase=np.concatenate([c.phase for c in columns]),
        zone=np.concatenate([c.zone for c in columns]),
        quantity=words("quantity"),
        t=numbers("t"),
        noise=numbers("noise"),
        reading=numbers("reading"),
        floor=numbers("floor"),
        series=np.repeat(np.arange(len(columns)), sizes),
    )
