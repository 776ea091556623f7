"""Contradictions of a recorded fold: with one strip held at its end, from the desk to
the gripper.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from cell.gap.subject.strip.preprocessing import FEWEST_POINTS
from cell.record.files import PROFILE, RESULT, TICKS
from cell.record.run import Run
from cell.record.tables import TIME_MARGIN
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array
from drivers.strip.engine import Touch
from drivers.strip.file import StripFile
from policies.path import FoldLine

LEAST_RISE = 0.01  # m above the desk, of a gripper that folds
# Limits in m, rad and s, beyond which what is off is noted and refused, or refused
# alone from where a run must start, as preflight allows a strip's length
START = (0.006, 0.03)
HANGING = (0.3,)  # of pitch from upright at a hanging start
HELD = (0.03,)  # by which half of the places may contradict one strip held at its end
TURN = (1.2,)  # from the gripper's pitch within which half of the midlines end
SHIFTS = (0.01, 0.015)  # by which midlines lie off gripper or desk
DELAYS = (0.07, 0.2)  # by which midlines are late or early for the gripper's path
SPREADS = np.array([0.06, 0.005])  # s, m: of delays and of shifts in x
END_ERROR = 0.0006  # m of a run's midlines at their ends, in common
SHORTEST_ARC = 1e-6  # m from a midline's last seen piece to the gripper
# by which l1 is not the way to the gripper, or a command not its place
ODD = (0.03, np.inf)
GAP = (0.2, np.inf)  # between two rows: the path in between is guessed
PERIOD = (0.02,)  # between rows, slower than any servo; the contract asks for 0.01
NOTICED = 0.1  # s by which a touch is usually noticed too early or late
# m by which displacement and l1 - l2 may differ as they are rounded
TOUCH_ROUNDING = 1e-3
DISPLACEMENT_SIGMAS = 5  # standard deviations by which they may differ besides


class Contradiction(NamedTuple):
    """How far a recorded fold contradicts itself in one respect: the deviations `off`
    [m, rad or s], the `file` that shows them, and the limits on their median.

    Beyond the first limit the median is noted, beyond the last one refused.
    """

    file: str
    what: str
    off: Array | float
    limits: tuple[float, ...]


def contradictions(
    run: Run, touch: Touch | None, strip: StripFile
) -> Iterator[Contradiction]:
    """Yield each respect in which a recorded fold, with the touch of the layers if it
    was measured, may contradict a strip of the stated length.
    """
    length = strip.length
    yield from _misses_of_rows(run)
    yield from _misses_of_start(run, length)
    yield from _misses_of_path(run, length)
    stated = None if run.result is None else run.result.displacement
    if touch is not None and stated is not None:
        yield _miss_of_displacement(run, stated, touch, length)
        yield from _misses_of_touch(run, touch, length)
    yield from _misses_of_midlines(run)


def _misses_of_rows(run: Run) -> Iterator[Contradiction]:
    """Yield contradictions between the times of a fold's rows, and between its
    commanded and its measured gripper motion.
    """
    ticks = run.ticks
    t = run.ticks.t
    z = run.ticks.z
    apart = np.diff(t)
    yield Contradiction(TICKS, "t: in s, half the rows are apart by", apart, PERIOD)
    what = f"t: after {t[apart.argmax()]:.2f} s two rows are apart by"
    yield Contradiction(TICKS, what, apart.max(), GAP)

    off_command = np.nan_to_num([ticks.x_cmd - ticks.x, ticks.z_cmd - z])
    lag = np.hypot(*off_command)[z > HELD[0]]
    what = "x_cmd, z_cmd: half lie off the gripper by"
    yield Contradiction(TICKS, what, lag, ODD)


def _misses_of_start(run: Run, length: float) -> Iterator[Contradiction]:
    """Yield contradictions between the first row of a fold, which starts flat or
    hanging, and where the gripper holds a strip of `length` [m] at such a start.
    """
    ticks = run.ticks
    x = float(ticks.x[0])
    z = float(ticks.z[0])
    at = f"start at x {x:.3f}, z {z:.3f} m is"
    if run.header.start == "hanging":
        upright = abs(ticks.pitch[0] - np.pi / 2)
        what = "pitch: a hanging start is off pi/2 by"
        yield Contradiction(TICKS, what, upright, HANGING)
        what = f"x: a hanging {at} beyond the strip by"
        yield Contradiction(TICKS, what, np.hypot(x, z) - length, START)
    else:
        what = f"x: a flat {at} off x {length:g}, z 0 m by"
        yield Contradiction(TICKS, what, np.hypot(x - length, z), START)


def _misses_of_path(run: Run, length: float) -> Iterator[Contradiction]:
    """Yield contradictions between a strip of `length` [m] and the gripper's path or
    the points where the strip leaves the desk.
    """
    ticks = run.ticks
    x = ticks.x
    z = ticks.z
    contact = ticks.contact_x
    what = "z: half the path lies under the desk by"
    yield Contradiction(TICKS, what, -z, START)
    if run.result is not None:
        what = f"z: rises less than {LEAST_RISE:g} m, by"
        yield Contradiction(TICKS, what, LEAST_RISE - z.max(), (0.0,))

    beyond = np.hypot(x, z) - length
    what = "x, z: half lie beyond the strip by"
    yield Contradiction(TICKS, what, beyond, HELD)
    too_far = np.hypot(x - contact, z) - (length - contact)
    what = "contact_x: half the contacts are too far from the gripper by"
    yield Contradiction(TICKS, what, too_far[np.isfinite(contact)], HELD)


def _miss_of_displacement(
    run: Run, displacement: float, touch: Touch, length: float
) -> Contradiction:
    """Contradiction between the stated `displacement` [m] of the folded edge and the
    two lengths that the `touch` of the layers gives, for a strip of `length` [m].
    """
    goal = FoldLine.of(length, run.header.line).goal
    measured = touch.to_grasped - touch.to_fixed + goal
    allowed = TOUCH_ROUNDING + DISPLACEMENT_SIGMAS * run.header.sigma.displacement
    what = "displacement: differs from l1 - l2 by"
    return Contradiction(RESULT, what, abs(displacement - measured), (allowed,))


def _misses_of_touch(run: Run, touch: Touch, length: float) -> Iterator[Contradiction]:
    """Yield contradictions between the two lengths that the touch of the layers gives
    and the strip's `length` [m] or the distance to the gripper.
    """
    l1 = touch.to_grasped
    l2 = touch.to_fixed
    ticks = run.ticks
    what = "l1, l2: are longer than the strip by"
    yield Contradiction(RESULT, what, l1 + l2 - length, HELD)

    late = TIME_MARGIN * np.linspace(-1, 1, 41)  # as a stopwatch
    x, z = (np.interp(touch.time + late, ticks.t, row) for row in (ticks.x, ticks.z))
    layer = np.hypot(x - l2, z)
    what = "l1: ends before the gripper by"
    yield Contradiction(RESULT, what, float(layer.min()) - l1, HELD)
    apart = np.abs(layer - l1)[np.abs(late) < NOTICED].min()
    what = "l1: differs from the way from the touch to the gripper by"
    yield Contradiction(RESULT, what, apart, ODD)


def _misses_of_midlines(run: Run) -> Iterator[Contradiction]:
    """Yield contradictions between the measured midlines of the strip and the desk, the
    gripper's position, its pitch, or the points where the strip leaves the desk.

    Midlines begin on the desk, where they are seen to it, and end at the gripper or
    before it, as it hides the strip, but not beside it: there a shift in x or a delay
    shows.
    """
    curves = dict(run.profile.curves())
    if not curves:
        return
    ticks = run.ticks
    t = np.array([*curves])
    rows = ticks.t
    path = np.column_stack([ticks.x, ticks.z])
    each = curves.values()
    ends = np.array([curve[-1] for curve in each])
    off = ends - interpolate_columns(t, rows, path)
    hidden = np.hypot(*off.T)
    what = "x, z: half the midlines end off the gripper by"
    yield Contradiction(PROFILE, what, hidden, HELD)

    before = [curve[-1 - len(curve) // FEWEST_POINTS] for curve in each]
    along = (ends - np.array(before)).T
    seen = np.hypot(*along)
    slope = np.arctan2(*along[::-1])
    turn = slope - np.interp(t, rows, ticks.pitch)
    turn = np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi
    what = "x, z: half the midlines leave its pitch by"
    yield Contradiction(PROFILE, what, np.abs(turn[seen > 0.0]), TURN)

    up = _rise_of_beginnings(run, curves)
    later, earlier = (interpolate_columns(t + s, rows, path) for s in (0.05, -0.05))
    # the way to the gripper is the chord of an arc from the last piece's middle on, or
    # straight where no pitch was recorded
    to_middle = (seen + hidden) / np.maximum(seen + 2.0 * hidden, SHORTEST_ARC)
    chord = slope - np.nan_to_num(turn) * to_middle
    normal = np.array([-np.sin(chord), np.cos(chord)])
    distance, per_delay = (
        np.einsum("nk,kn->n", moved, normal)
        for moved in (off - (0.0, up), (earlier - later) / 0.1)
    )
    yield from _misses_beside(np.column_stack([distance, per_delay, normal[0]]), up)
    yield from _misses_of_contacts(run, curves)


def _rise_of_beginnings(run: Run, curves: Mapping[float, Array]) -> float:
    """Median height [m] at which the midlines in `curves`, given by time, begin above
    the height of a desk contact; zero where they are not seen down to the desk.
    """
    (highest,) = HELD
    is_lifted = np.interp([*curves], run.ticks.t, run.ticks.z) > highest
    heights = np.array([curve[0, 1] for curve in curves.values()])[is_lifted]
    if not len(heights):
        return 0.0
    up = float(np.median(heights)) - run.header.contact_height
    return up if up < highest else 0.0  # others see the upper part alone


def _misses_beside(across: Array, up: float) -> Iterator[Contradiction]:
    """Yield contradictions of midlines that end beside the gripper, and of midlines
    that begin `up` [m] above the desk.

    `across` (n, 3) are the ends' distances [m] across the strip, and these per delay
    and per shift.
    """
    apart = abs(float(np.median(across[:, 0])))
    what = "x, z: half the midlines end beside the gripper by"
    yield Contradiction(PROFILE, what, apart, SHIFTS[1:])

    side = "above" if up > 0 else "under"
    what = f"z: half the midlines begin {side} the desk by"
    yield Contradiction(PROFILE, what, abs(up), SHIFTS)
    late, out = _delay_and_shift(across)
    side = "outside" if out > 0 else "inside"
    what = f"x: the midlines end {side} the path by"
    yield Contradiction(PROFILE, what, abs(out), SHIFTS)
    order = "lag behind" if late > 0 else "lead"
    what = f"t: the midlines {order} the gripper by"
    yield Contradiction(PROFILE, what, abs(late), DELAYS)


def _misses_of_contacts(
    run: Run, curves: Mapping[float, Array]
) -> Iterator[Contradiction]:
    """Yield contradictions between the recorded points where the strip leaves the desk
    and the midlines in `curves` that are seen down to the desk.
    """
    stamps, places = run.ticks.contacts()
    if not len(stamps):
        return
    apart = []
    for time, curve in curves.items():
        if curve[0, 1] < HELD[0]:
            contact = np.array([np.interp(time, stamps, places), 0.0])
            apart.append(np.hypot(*(curve - contact).T).min())
    what = "contact_x: half the contacts lie off the midlines by"
    yield Contradiction(TICKS, what, np.array(apart), HELD)


def _delay_and_shift(across: Array) -> tuple[float, float]:
    """Delay [s] and shift along x [m] that best explain why measured midlines end
    beside the gripper, by linear regression with a prior about zero.

    `across` (n, 3) are the ends' distances [m] across the strip, and these per delay
    and per shift. Linear regression with a normal prior: min |(d - X b) / sigma|^2 + |b
    / SPREADS|^2.
    """
    near = across[np.abs(across[:, 0]) < HELD[0]] / (END_ERROR * np.sqrt(len(across)))
    off, *slopes = near.T
    columns = np.vstack([np.transpose(slopes), np.diag(1 / SPREADS)])
    (delay, shift), *_ = np.linalg.lstsq(columns, np.pad(off, (0, 2)))
    return float(delay), float(shift)
