"""Measured motion of a run on an even grid, low-pass filtered, with rates and
accelerations.
"""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.ndimage import binary_dilation
from scipy.signal import butter, filtfilt, welch

from cell.gap.subject.mechanism.closed_loops import ClosedLoops
from cell.gap.subject.mechanism.effect import Readings
from cell.gap.subject.mechanism.recordings import Recording
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array, frozen

ORDER = 3  # of the Butterworth filter, run forth and back
# of the frequency that holds most of the rate; Butterworth's passband is flat below
CUTOFF = 1.5
# of the rate's power; times the encoder's noise above which power counts
MOST, FLOOR = 0.99, 10.0
SLOWEST, FASTEST = 5.0, 25.0  # bounds of the cutoff, by the pace of the motion
# times the cutoff, for motion: mechanics are not linear (3 and 5 do no better)
WIDER = 2.0
# 1/cutoff from an end or a gap at which its effect on the filter has decayed
SETTLED = 10.0
# 1/cutoff, and median steps of the clock, between readings that are bridged; beyond
# lies a gap
BRIDGED, STEPS = 0.5, 2.5
GRID = 4000  # places of a run at most at which torques are computed
butterworth = cache(butter)  # of one cutoff for all simulations of a run


class FilteredMotion(NamedTuple):
    """Measured motion and torques of a run, both low-pass filtered, at evenly spaced
    times `t` [s].

    Positions, rates and accelerations `q`, `v`, `a` (m, joints) and the measured
    `torques` (signals, m) pass one filter, at `WIDER` times the `cutoff` [rad/s] below
    which torques are compared. `known` (m,) is false near gaps of the record. `shake`
    (2, encoders) is the standard deviation of v and a that encoder noise makes in the
    means of samples, and `moves` (m or 1, joints, encoders) how joints follow encoders.
    Along loops `forces` (m, actuators, joints) are those of actuators by torque of the
    open joints.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    torques: Array
    known: NDArray[np.bool_]
    cutoff: float
    shake: Array
    moves: Array
    forces: Array | None = None

    def below_cutoff(self, rows: Array, t: Array) -> Array:
        """Values at the times `t` [s], of shape (rows, times), of the `rows` along the
        even times, without what is faster than the cutoff.
        """
        grid = self.t
        slow = _low_pass(rows, grid[1] - grid[0], self.cutoff)
        return interpolate_columns(t, grid, slow.T).T


def cutoff_of(
    recordings: Sequence[Recording], joints: Sequence[str], pace: float
) -> float:
    """Angular frequency [rad/s] below which the measured motion of `joints` has most of
    its power, over all `recordings`.

    It is the median of the `recordings`, in power of rates: what differs between them
    is noise. Beyond it lies the encoders' noise, which in accelerations grows with the
    cutoff's power of 2.5.
    """
    found = [_cutoff(recording, joints) for recording in recordings]
    return float(np.clip(np.median(found), SLOWEST * pace, FASTEST * pace))


def _cutoff(recording: Recording, joints: Sequence[str]) -> float:
    """Angular frequency [rad/s] below which the fastest of `joints` has most of its
    power in one recording.
    """
    grid = _grid(recording)
    q = _resample(recording, joints, grid)
    rate = 2.0 * np.pi / (grid[1] - grid[0])
    w, power = welch(q, rate, nperseg=min(256, len(grid)))

    # no joint moves in the upper quarter of frequencies
    noise = np.median(power[:, len(w) * 3 // 4 :], axis=1, keepdims=True)
    of_motion = np.maximum(power - FLOOR * noise, 0.0)

    # below which frequency MOST of the power of each joint's rate lies
    below = np.cumsum(of_motion * w**2, axis=1)
    first = np.argmax(below >= MOST * below[:, -1:], axis=1)
    return CUTOFF * float(w[first].max())


def _grid(recording: Recording) -> Array:
    """Evenly spaced times [s] over a recording, apart by the median step of its
    readings, or by more where these would be over GRID times.
    """
    t = recording.t
    end = recording.t[-1]
    return np.arange(0.0, end, max(np.median(np.diff(t)), end / GRID))


def _resample(recording: Recording, names: Sequence[str], grid: Array) -> Array:
    """Columns called `names`, a row for each, interpolated at the times `grid` [s]."""
    return np.array([np.interp(grid, *recording.known(name)) for name in names])


def _gaps(
    recording: Recording, names: Sequence[str], grid: Array, longest: float
) -> NDArray[np.bool_]:
    """Mask, one value for each time in `grid` [s], of the times between two readings of
    a column that are more than `longest` [s] apart, and before its first and after its
    last.
    """
    gaps = np.zeros(len(grid), dtype=bool)
    for name in names:
        known, _ = recording.known(name)
        after = np.searchsorted(known, grid, side="right")
        gaps |= np.diff(known, prepend=-np.inf, append=np.inf)[after] > longest
    return gaps


def motion_of(
    recording: Recording,
    joints: Sequence[str],
    torques: Sequence[str],
    cutoff: float,
    width: float,
    loops: ClosedLoops | None,
    barred: Callable[[Array, Array], NDArray[np.bool_]],
) -> FilteredMotion:
    """Motion and torques of a recording, low-pass filtered at `cutoff` [rad/s], for
    samples that last `width` [s].

    `joints` are those that are measured; the others of closed `loops` follow them.
    Readings count as gaps where positions (m, joints) and torques (signals, m) are
    `barred`. Both pass one filter without phase (Butterworth, forth and back), and
    rates are those of the filtered positions: what is linear in a mechanism holds as
    well after as before. What is not holds the better the wider the filter; the narrow
    one follows the mechanics.
    """
    grid = _grid(recording)
    dt = grid[1] - grid[0]
    raw = _resample(recording, joints, grid)
    measured = _resample(recording, torques, grid)

    # no reading for so long is a gap
    longest = max(BRIDGED / cutoff, STEPS * np.median(np.diff(recording.t)))

    # one filter for both
    wide = min(WIDER * cutoff, 0.8 * np.pi / dt)
    cutoff = min(cutoff, wide)
    filtered = _low_pass(raw, dt, wide)
    q = loops.close(filtered.T) if loops else filtered.T

    # what is no reading, or none of the mechanics
    excluded = _gaps(recording, [*joints, *torques], grid, longest)
    excluded |= barred(q, measured)
    stride = max(1, int(1.0 / wide / dt))
    moves = np.eye(len(joints))[None]
    forces = None
    if loops:
        forces, moves, movable = loops.maps(q[::stride])
        excluded |= np.repeat(~movable, stride)[: len(grid)]
    reach = min(round(SETTLED / cutoff / dt), len(grid) // 10)
    known = ~_near_gaps(excluded, reach)

    # white noise of the encoders, of which the filter takes out the part above its
    # cutoff
    noise = (raw - filtered).std(axis=1) / np.sqrt(1.0 - wide * dt / np.pi)
    shake = np.outer(_noise_gain(dt, cutoff, width), noise)

    q, v, a = (frozen(x[::stride]) for x in _derivatives(grid, q))
    return FilteredMotion(
        t=frozen(grid[::stride]),
        q=q,
        v=v,
        a=a,
        torques=frozen(_low_pass(measured, dt, wide)[:, ::stride]),
        known=known[::stride],
        cutoff=cutoff,
        shake=frozen(shake),
        moves=moves,
        forces=forces,
    )


def _low_pass(x: Array, dt: float, cutoff: float) -> Array:
    """Copy of the rows of `x`, whose values are `dt` [s] apart, without what is faster
    than `cutoff` [rad/s].
    """
    slow: Array = filtfilt(*butterworth(ORDER, cutoff * dt / np.pi), x, axis=-1)
    return slow


def _derivatives(t: Array, x: Array) -> tuple[Array, Array, Array]:
    """The columns of `x` and their first and second derivatives by the times `t` [s],
    all of the same shape.
    """
    spline = make_interp_spline(t, x, k=5)
    return x, spline(t, nu=1), spline(t, nu=2)


def _noise_gain(dt: float, cutoff: float, width: float) -> Array:
    """Standard errors of the mean rate and the mean acceleration over `width` [s] that
    white noise of unit size causes in a filtered position.
    """
    count = max(1, round(width / dt))
    half = count + round(2.0 * SETTLED / cutoff / dt)
    begin = half - count // 2
    # weights of a mean, in the middle of what the filter sees
    mean: Array = np.zeros(2 * half + 1)
    mean[begin : begin + count] = 1.0 / count
    t: Array = dt * np.arange(2.0 * half + 1.0)
    _, *moves = _derivatives(t, _low_pass(mean, dt, cutoff))
    errors: Array = np.linalg.norm(moves, axis=1)
    return errors


def _near_gaps(gaps: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Mask of the readings that lie within `reach` readings of a gap, where the mask
    `gaps` is true, or of an end.
    """
    near: NDArray[np.bool_] = binary_dilation(gaps, iterations=reach, border_value=1)
    return near


def true_motion(motion: FilteredMotion, errors: Readings) -> tuple[Array, Array, Array]:
    """True positions, rates and accelerations, each of shape (times, joints), of a
    measured motion whose sensors have the given `errors`.

    Readings stamped late show an earlier time, so that the motion at t is read at t +
    delay; in the last `delay` seconds, where no reading follows, the last one is held.
    """
    t = motion.t
    delay = errors.delay
    moves = [motion.q, motion.v, motion.a]
    if delay:
        moves = [interpolate_columns(t + delay, t, columns) for columns in moves]
    q, v, a = moves
    scale = 1.0 + errors.scale
    return (q - errors.bias) / scale, v / scale, a / scale


def link_motion(
    motion: FilteredMotion, deflection: Array, q: Array, v: Array, a: Array
) -> tuple[Array, Array, Array]:
    """Positions, rates and accelerations of the links, of shape (times, joints) like
    `q`, `v` and `a` of the motors, behind which they lag by `deflection`.
    """
    t, behind = motion.t, (q - deflection) - q  # in floating point: nearly -deflection
    smooth = _low_pass(behind.T, t[1] - t[0], motion.cutoff)
    offset, rate, acceleration = _derivatives(t, smooth.T)
    return q + offset, v + rate, a + acceleration
