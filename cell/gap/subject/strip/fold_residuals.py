"""Residuals of a fold: measured minus simulated samples, with the rig's measurement
errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.strip.midline_residuals import (
    group_means,
    nearest_ends,
    signed_distances,
)
from cell.gap.subject.strip.runs import MeasuredRun
from cell.gap.subject.strip.simulation import SimulatedMotion
from cell.gap.subject.subject import Residuals, Samples, Series, Words
from drivers.base.geometry import interpolate_columns, lengths
from drivers.base.types import Array
from drivers.strip.engine import StripMotion, Touch
from drivers.strip.model import StripModel
from drivers.strip.observation import (
    image_stamp,
    imaged_time,
    measured_contact,
    measured_touch,
    reported_force,
    true_points,
)
from drivers.strip.rod.engine import GripperPath
from policies.path import TAKEOVER_HEIGHT

FALL = 1.0  # s before the touch in which the fold comes down
# s over which the gripper's own motion is averaged: shakes are no motion
AVERAGING_TIME = 0.6
HOLD_SPEED = 0.25  # of the run's usual speed, below which the gripper holds
RETURN_SPEED = 0.3  # of the run's usual speed at which it moves towards the lift's side
SPEED_INTERVAL = 0.1  # s between the times of which the usual speed is taken
STANDING_SPEED = 0.01  # m/s up to which a gripper stands
GUESSED_SPEED = 0.1  # m/s, usual speed of a run that never moves
ZONES = ("fixed", "middle", "grasped")
SAMPLE_TIME = 0.3  # s of one sample
# s of one sample of the force, short enough to show when a shake was reported
BRIEF = 0.05
TOUCH_TIME = 0.03  # s, noise of the time of a touch where the run states none
# m of travel before which a strip just lifted shows more of its grip than of itself
GRIP_TRAVEL = 0.15
SNAP = 0.15  # s before the touch in which any model is off
FEWEST_POINTS = 4  # points of a profile's sample
FLOORS = {
    "profile": 0.00025,
    "contact_x": 0.0006,
    "displacement": 0.001,
    "touch_time": 0.02,
    "force": 0.0001,
}
"""Standard deviations [m, s, N] of errors that any strip model has, by measured
quantity.

Rod and chain differ by a tenth of a millinewton in `force`; the coarse rod errs by more
where a gripper jerks.
"""


def phases(run: MeasuredRun, t: Array) -> Words:
    """Phase of the fold, such as `lift` or `carry`, at each of the times `t` [s], as
    words of the same shape.
    """
    # the usual speed of this fold
    even = np.arange(run.t[0], run.end, SPEED_INTERVAL)
    speeds, _ = _averaged_motion(run, even)
    moving = speeds > STANDING_SPEED
    usual_speed = np.median(speeds[moving]) if moving.any() else GUESSED_SPEED

    # later ones win
    speed, back = _averaged_motion(run, t)
    words = np.full(len(t), "carry", dtype="U8")
    words[back > RETURN_SPEED * usual_speed] = "return"
    words[speed < HOLD_SPEED * usual_speed] = "hold"
    if run.touch:
        words[t > run.end - FALL] = "fall"
    words[t < _end_of_lift(run)] = "lift"
    return words


def _end_of_lift(run: MeasuredRun) -> float:
    """Time [s] at which the gripper has risen so high that the policy takes over; the
    run's end where it never does, or where the strip hangs from the start.
    """
    risen = run.poses[:, 1] >= TAKEOVER_HEIGHT
    if run.hanging or not risen.any():
        return run.end
    return float(run.t[np.argmax(risen)])


def zones(s: Array, length: float) -> Words:
    """Which third of a strip of `length` [m] each of the arc lengths `s` [m] lies in,
    as words of the same shape.
    """
    third = np.clip((3.0 * s / length).astype(np.int64), 0, 2)
    return np.array(ZONES)[third]


def _averaged_motion(run: MeasuredRun, t: Array) -> tuple[Array, Array]:
    """Speed [m/s] of the gripper and its velocity [m/s] along x, each averaged over a
    short interval about each of the times `t` [s].
    """
    rows = run.t
    half = AVERAGING_TIME / 2
    begin, end = (np.clip(t + side, rows[0], rows[-1]) for side in (-half, half))
    places = run.poses[:, :2]
    before, after = (interpolate_columns(at, rows, places) for at in (begin, end))
    rate = (after - before) / np.maximum(end - begin, 1e-9)[:, None]
    return lengths(rate), rate[:, 0]


@dataclass(frozen=True, slots=True)
class SampleGroups:
    """Readings of one measured quantity, such as the desk contact, grouped into
    samples: `order` (n,) lists the indices of the readings, and `edges` (k + 1,) where
    each sample begins and the last ends.

    Of each sample (k,): `phase`, `zone`, mean
    time `t` [s]; `sigma` is that of a reading.
    """

    order: NDArray[np.int64]
    edges: NDArray[np.int64]
    phase: Words
    zone: Words
    t: Array
    sigma: float

    def __len__(self) -> int:
        return len(self.t)


class Layout(NamedTuple):
    """Samples of a fold by measured quantity: the strip's profile, its desk contact,
    the force along x and along z, and `samples`, which hold all of them and the touch
    of the layers, if any.
    """

    profile: SampleGroups
    contact: SampleGroups
    force: tuple[SampleGroups, SampleGroups]
    samples: Samples


def layout(run: MeasuredRun, length: float) -> Layout:
    """Group the readings of the measured fold `run` of a strip of `length` [m] into
    samples.
    """
    sigma = run.sigma
    stamps, _, image, s = run.images
    profile = _part(
        run,
        t=stamps[image],
        zone=zones(s, length),
        sigma=sigma.profile,
        fewest=FEWEST_POINTS,
    )

    # a soft strip that is pushed along the desk buckles at its fixed edge or not, by
    # chance
    t = run.contact_t
    x = run.contact_x
    buckled = (x < length / 3) & (phases(run, t) == "lift")
    contact = _part(
        run, t, zone=zones(x, length), sigma=sigma.contact_x, fewest=1, left_out=buckled
    )
    force = _force_part(run, length, axis=0), _force_part(run, length, axis=1)

    # a camera's error shifts the whole image
    floor = FLOORS["profile"]
    fraction = np.hypot(1.0, (run.plane_error or 0.0) / floor)
    columns = [
        *_columns(profile, "profile", fraction * floor, by_zone=True),
        *_columns(contact, "contact_x", fraction * FLOORS["contact_x"]),
        *(each for part in force for each in _columns(part, "force", FLOORS["force"])),
        *_touch_columns(run),
    ]
    return Layout(
        profile=profile, contact=contact, force=force, samples=Samples.stack(columns)
    )


def _force_part(run: MeasuredRun, length: float, axis: int) -> SampleGroups:
    """Samples of the force of the strip on the gripper along one axis, 0 for x and 1
    for z; none where the run states no noise for force.
    """
    reported = run.force_t if run.has_force else np.empty(0)
    unknown = np.isnan(run.force[: len(reported), axis])
    grasped = zones(np.full(len(reported), length), length)
    return _part(
        run,
        t=reported,
        zone=grasped,
        sigma=run.sigma.force or 0.0,
        fewest=1,
        left_out=unknown,
        span=BRIEF,
    )


def _part(
    run: MeasuredRun,
    t: Array,
    zone: Words,
    sigma: float,
    fewest: int,
    left_out: NDArray[np.bool_] | None = None,
    span: float = SAMPLE_TIME,
) -> SampleGroups:
    """Group readings at times `t` [s] into samples, each of one third of the strip, one
    phase of the fold, and one interval of `span` [s].

    Readings of the mask `left_out`, and samples of less than `fewest` readings, are
    left out.
    """
    # compared are times after the lift's start, before snap and touch
    lifted = run.hanging | (np.interp(t, run.t, run.travel) >= GRIP_TRAVEL)
    end = run.end - (SNAP if run.touch else 0.0)
    compared = lifted & (t >= run.t[0]) & (t < end)
    if left_out is not None:
        compared &= ~left_out
    used = np.flatnonzero(compared)

    # readings sorted by zone, then slot, then phase
    phase = phases(run, t)
    order = list(dict.fromkeys(phase))
    ranks = _ranks(zone, ZONES), np.floor(t / span), _ranks(phase, order)
    keys = np.stack(ranks)[:, used]
    sorting = np.lexsort(keys[::-1])

    # a sample ends where one of them changes
    borders = np.flatnonzero(np.diff(keys[:, sorting]).any(axis=0)) + 1
    rows = [row for row in np.split(used[sorting], borders) if len(row) >= fewest]
    first_rows = [row[0] for row in rows]
    return SampleGroups(
        order=np.concatenate([*rows, np.empty(0, dtype=np.int64)]),
        edges=np.cumsum([0, *map(len, rows)]),
        phase=phase[first_rows],
        zone=zone[first_rows],
        t=np.array([t[row].mean() for row in rows]),
        sigma=sigma,
    )


def _ranks(words: Words, order: Sequence[str]) -> Array:
    """Position of each of `words` in the list `order`, as numbers."""
    rank = {word: i for i, word in enumerate(order)}
    return np.array([rank[word] for word in words], dtype=np.float64)


def _columns(
    part: SampleGroups, channel: str, floor: float, *, by_zone: bool = False
) -> list[Series]:
    """Time series of the samples of `part` for one `channel`, a single one or, with
    `by_zone`, one for each third of the strip.
    """
    sigma = part.sigma
    zone = part.zone
    noise = sigma / np.sqrt(np.maximum(np.diff(part.edges), 1))
    groups = [[z] for z in ZONES] if by_zone else [ZONES]
    return [
        Series(
            channel=channel,
            quantity=channel,
            phase=part.phase[rows],
            zone=zone[rows],
            t=part.t[rows],
            noise=noise[rows],
            reading=sigma,
            floor=floor,
        )
        for rows in (np.isin(zone, group) for group in groups)
    ]


def _touch_columns(run: MeasuredRun) -> list[Series]:
    """Three series of one sample for the touch of the layers: its time, the mean of its
    distances from both edges, and the displacement; none where no touch was measured.

    Both distances are measured alike, so that their difference and their mean err
    independently.
    """
    if not run.touch:
        return []
    sigma = run.sigma.displacement
    floor = FLOORS["displacement"]
    sizes = {
        "touch_time": (run.sigma.touch_time or TOUCH_TIME, FLOORS["touch_time"]),
        "touch_x": (sigma / 2, floor / 2),
        "displacement": (sigma, floor),
    }
    return [
        Series(
            channel="layer_touch",
            quantity=quantity,
            phase="touch",
            zone="middle",
            t=np.array([run.touch.time]),
            noise=noise,
            reading=noise,
            floor=error,
        )
        for quantity, (noise, error) in sizes.items()
    ]


CONTACT_LIMIT = 1.0  # bending lengths between contacts that are still one and the same


@dataclass(frozen=True, slots=True, eq=False)
class FoldResiduals:
    """Callable that computes the residuals of one measured fold, which are its measured
    samples minus those of a simulated motion.

    `length` and stated `bending_length` [m] are the strip's.
    """

    run: MeasuredRun
    layout: Layout
    length: float
    bending_length: float

    def __call__(self, model: StripModel, motion: SimulatedMotion | None) -> Residuals:
        """Residuals of the fold against the simulated `motion` of `model`, one for each
        sample; NaN where the motion is None.
        """
        profile, _, along_axes, samples = self.layout
        if not motion:
            lost = np.full(len(samples), np.nan)
            return Residuals(lost, lost.copy())
        force = self._force_residuals(model, motion)
        channels = [
            average(self.distances(model, motion, profile.order), profile),
            self._contact_averages(model, motion),
            *(average(force[p.order, axis], p) for axis, p in enumerate(along_axes)),
            self._touch_residuals(model, motion),
        ]
        mean, square = (np.concatenate(rows) for rows in zip(*channels, strict=True))
        return Residuals(mean, square)

    def shape_index(self, model: StripModel, motion: SimulatedMotion) -> Array:
        """Which simulated shape belongs to each image of the run, as an index with a
        fraction, of shape (images,).
        """
        stamps = self.run.images.stamps
        return motion.index_at(imaged_time(model.observation, stamps))

    def distances(
        self, model: StripModel, motion: SimulatedMotion, points: NDArray[np.int64]
    ) -> Array:
        """Distances (n,) [m] of the measured midline points with the indices `points`
        (n,) from the simulated midline, positive to its left as seen from the fixed
        edge.
        """
        _, places, image, s = self.run.images
        distances = np.empty(len(points))
        if len(distances):
            signed_distances(
                np.ascontiguousarray(true_points(model, places[points])),
                image[points],
                s[points],
                self.shape_index(model, motion),
                motion.shapes,
                motion.arc * self.length,
                distances,
            )
        return distances

    def _contact_averages(
        self, model: StripModel, motion: SimulatedMotion
    ) -> tuple[Array, Array]:
        """Mean [m] and mean square [m^2], one for each sample, of the residuals of the
        point where the strip leaves the desk.

        A strip with a hump, as over a crease, leaves the desk there and at the fold;
        which of them an image shows depends on the hump's height. So a contact far from
        the simulated one is compared with the nearest place where the simulated strip
        leaves the desk.
        """
        run = self.run
        part = self.layout.contact
        observation = model.observation
        measured = run.contact_x[part.order]
        time = imaged_time(observation, run.contact_t[part.order])
        simulated = np.interp(time, motion.t, motion.contact_x)
        residuals = measured - measured_contact(observation, simulated)

        limit = CONTACT_LIMIT * self.bending_length
        far = np.abs(residuals) >= limit
        ends = simulated[far]
        nearest_ends(
            ends + residuals[far],
            motion.index_at(time[far]),
            motion.shapes,
            run.contact_height,
            ends,
        )
        residuals[far] = measured[far] - measured_contact(observation, ends)

        averages = average(residuals, part)
        near = np.abs(averages[0]) < limit
        mean, square = np.where(near, averages, np.nan)
        return mean, square

    def _force_residuals(self, model: StripModel, motion: SimulatedMotion) -> Array:
        """Measured minus simulated force [N] of the strip on the gripper, a row for
        each reading with columns for x and z; NaN where it was not measured.
        """
        t = self.run.force_t
        return self.run.force - reported_force(
            model.observation, t, motion.t, motion.force
        )

    def _touch_residuals(
        self, model: StripModel, motion: SimulatedMotion
    ) -> tuple[Array, Array]:
        """Residuals of the touch of the layers in time [s], mean distance to both edges
        [m] and displacement [m], and their squares; NaN where the simulation has no
        touch.

        Both are empty (0,) where the run measured no touch.
        """
        measured = self.run.touch
        if not measured:
            return np.empty(0), np.empty(0)
        values = _touch_values(measured)
        simulated = simulated_touch(self.run, model, motion)
        residuals = values - (_touch_values(simulated) if simulated else np.nan)
        return residuals, residuals**2


def simulated_touch(
    path: MeasuredRun | GripperPath,
    model: StripModel,
    motion: SimulatedMotion | StripMotion,
) -> Touch | None:
    """Touch of the layers in the simulated `motion`, as camera images and the reported
    gripper `path` would show it; None where the layers do not touch.

    Along the reported `path` the gripper moves; `motion` is the true one.
    """
    touch = motion.touch
    if not touch:
        return None
    grip = interpolate_columns(touch.time, motion.t, motion.poses)
    stamp = image_stamp(model.observation, touch.time)
    reported = interpolate_columns(stamp, path.t, path.poses)
    return measured_touch(model, touch, grip, reported)


def _touch_values(touch: Touch) -> Array:
    """Three values of a touch of the layers: its time [s], the mean of its distances to
    both edges [m], and the displacement [m].
    """
    distance = 0.5 * (touch.to_grasped + touch.to_fixed)
    return np.array([touch.time, distance, touch.displacement])


def average(values: Array, part: SampleGroups) -> tuple[Array, Array]:
    """Mean and mean square, each of shape (samples,), of the readings in each sample of
    `part`, where readings far from the sample's median are clipped.
    """
    mean, square = np.empty((2, len(part)))
    if len(mean):
        group_means(np.ascontiguousarray(values), part.edges, part.sigma, mean, square)
    return mean, square
