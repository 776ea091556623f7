"""Tables of runs: their numbers, and the checks that every recording passes.

What cannot be used at all is refused as it is read; what costs accuracy is a finding.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from cell.gap.subject.subject import Finding, bad
from cell.record.columns import check_order
from cell.record.files import PROFILE
from drivers.base.errors import ConfigurationError, in_percent
from drivers.base.readers import read_parquet
from drivers.base.types import Array

MOST_ROWS = 5_000_000  # of a table; more is a mistake, or must be thinned
JUMP = 50.0  # median steps in one: the clock jumped
SPARSE_COLUMNS = frozenset({"t", "contact_x", "contact_t", "pitch", "f_x", "f_z"})
"""Columns that hold numbers in some rows alone, or need not be there (formats.md)."""

# Thresholds of complaints about a recording. Assumed: no fault was measured; runs of
# the twin and recordings of real pendulums stay within. Pairs are (worth a remark, not
# to be fitted).
LOST_ROWS = (0.02, 0.3)  # fraction that is missing or holds no number
LOST_IMAGES = (0.1, 0.6)  # fraction that is missing
STUCK = 0.2  # s that a reading stands still while it should change
MOVED = 0.01  # m or rad by which its command changes meanwhile
REPEATED = 0.05  # of other neighbours, fraction that may be equal
CLIPPED = 0.05  # s that readings keep a largest or smallest value, more than once
# fraction of the median step of the clock by which the middle half of the steps differ
UNEVEN = 0.5

TURN = 2.0 * np.pi  # rad
FAST, FAR = 200.0, 100.0  # rad/s and rad that no joint of an arm reaches
LEAP = 0.1  # rad in a row beyond the rows about it, which no joint makes
LEAPS = 10.0  # median steps of the rows about it, below which a step is no leap
NEIGHBOURS = 9  # rows


def read_table(path: Path) -> dict[str, Array]:
    """Numeric columns (n,) of a Parquet file, NaN if infinite; ConfigurationError if
    broken.
    """
    table = read_parquet(path)
    columns = {}
    for name in table.column_names:
        try:
            values = np.array(table[name], dtype=np.float64)
            columns[name] = np.where(np.isinf(values), np.nan, values)
        except (TypeError, ValueError):
            continue
    return columns


def column(table: Mapping[str, Array], name: str, path: Path) -> Array:
    """Column `name` (n,) of a table read from `path`, which must be finite throughout.

    Raises ConfigurationError where the column is missing or holds a value that is not
    finite.
    """
    if name not in table:
        raise ConfigurationError(
            f"{path}: {name}: this column is missing (or not numbers); add it"
        )
    values = table[name]
    for row in np.flatnonzero(~np.isfinite(values))[:1]:
        raise ConfigurationError(
            f"{path}: {name}: row {row} is not a number; every row must be one"
        )
    return values


def clock_of(table: Mapping[str, Array], path: Path, least: int) -> Array:
    """Times (n,) [s] of the rows of a table: at least so many, in order, none lost.

    Raises ConfigurationError where they are too few or too many, do not increase, or
    jump.
    """
    t = column(table, "t", path)
    if not least <= len(t) <= MOST_ROWS:
        raise ConfigurationError(
            f"{path}: t: has {len(t)} rows; at least {least} are needed, at"
            f" most {MOST_ROWS} are read"
        )

    check_order(t, str(path))
    steps = np.diff(t)
    longest = steps.max()
    usual = np.median(steps)
    if longest > JUMP * usual:
        raise ConfigurationError(
            f"{path}: t: jumps by {longest:g} s at row {np.argmax(steps) + 1}"
            f" (steps of {usual:g} s); the clock was set or rows are lost: cut the run"
            " there"
        )

    return t


def clock(t: Array) -> Iterator[Finding]:
    """Findings on the times `t` (n,) [s] of rows: missing rows and uneven steps."""
    steps = np.diff(t)
    if not (steps > 0.0).all():  # the reader refuses rows out of order
        return

    worst = np.argmax(steps)
    gap = f"the rows are missing, the longest gap {steps[worst]:.2g} s at"
    remedy = "record on a machine that keeps up, or leave the run out"
    yield from _lost(
        what="samples",
        t=t,
        limits=LOST_ROWS,
        words=f"{gap} {t[worst]:.2f} s",
        remedy=remedy,
    )
    low, usual, high = np.quantile(steps, [0.25, 0.5, 0.75])
    if high - low > UNEVEN * usual:
        yield Finding(
            what="clock",
            words=(
                f"half of the steps between rows lie between {1e3 * low:.2g} and "
                f"{1e3 * high:.2g} ms, the others beyond"
            ),
            remedy="stamp a reading when it is made, not when it arrives",
        )


def images(t: Array) -> Iterator[Finding]:
    """Finding that images are missing, by gaps in the image times `t` (n,) [s] of
    profile points.

    A stamp may repeat: each point of a profile bears that of its image.
    """
    stamps = np.unique(t)
    if len(stamps) > 2:
        remedy = "look at light and segmentation where they are, or leave the run out"
        words = "the images are missing"
        yield from _lost(
            what="images", t=stamps, limits=LOST_IMAGES, words=words, remedy=remedy
        )


def _lost(
    what: str, t: Array, limits: tuple[float, float], words: str, remedy: str
) -> Iterator[Finding]:
    """Finding that between times (n,) [s] a fraction is missing: a step of k median
    steps lacks k - 1 of them.
    """
    steps = np.diff(t)
    missing = np.round(np.maximum(steps / np.median(steps) - 1.0, 0.0)).sum()
    lost = missing / (missing + len(t))
    noted, most = limits
    if lost > noted:
        yield Finding(
            what=f"lost {what}",
            words=f"{in_percent(lost)} of {words}",
            remedy=remedy,
            level="bad" if lost > most else "fair",
        )


def values(
    name: str, t: Array, value: Array, command: Array | None = None
) -> Iterator[Finding]:
    """Findings on a column `value` (n,) at times `t` (n,) [s]: gaps, stuck and clipped
    readings.

    A reading is stuck that stands still while its `command` (n,) changes.
    """
    is_number = np.isfinite(value)
    lost = 1.0 - is_number.mean()
    if lost > LOST_ROWS[0]:
        yield Finding(
            what="lost samples",
            words=f"{name} holds no number in {in_percent(lost)} of the rows",
            remedy="mend the reading, or leave the run out",
        )
    if is_number.any():
        stuck = [] if command is None else [*stuck_reading(name, t, value, command)]
        yield from stuck or _saturation(name, t, value, command)


def stuck_reading(
    name: str, t: Array, value: Array, command: Array | None = None
) -> Iterator[Finding]:
    """Finding on a reading (n,) that stands still for long while its `command` (n,)
    moves or, without one, where it changes in nearly every row elsewhere.

    Where it stands at its largest or smallest value then, it is at a limit.
    """
    still = [*_still(value)]
    long = [(a, b) for a, b in still if t[b] - t[a] > STUCK]
    if command is None:
        within, repeated = (sum(b - a for a, b in spans) for spans in (long, still))
        why = "and changes in every row elsewhere"
        if repeated - within >= REPEATED * (len(t) - 1 - within):
            return
        limits = np.nanmin(value), np.nanmax(value)
        long = [(a, b) for a, b in long if value[a] not in limits]
    else:
        why = "while its command moves"
        long = _moving(long, command)
    for first, last in long[:1]:
        words = (
            f"{name} stands still at {value[first]:.4g} from {t[first]:.2f} to"
            f" {t[last]:.2f} s (row {first} on), {why}"
        )
        yield bad("stuck reading", words, "mend the reading; leave the run out")


def _saturation(
    name: str, t: Array, value: Array, command: Array | None
) -> Iterator[Finding]:
    """Findings on a reading that stays at an end of its range, though any `command`
    moves on.
    """
    inner = [(a, b) for a, b in _still(value) if a > 0 and b < len(t) - 1]
    if command is not None:
        inner = _moving(inner, command)
    for limit, word in ((np.nanmax(value), "largest"), (np.nanmin(value), "smallest")):
        spans = [t[b] - t[a] for a, b in inner if value[a] == limit]
        long = [span for span in spans if span > CLIPPED]
        if len(long) > 1:
            yield Finding(
                what="saturation",
                words=(
                    f"{name} stands {len(long)} times at its {word} value {limit:.4g},"
                    f" for {max(long):.2g} s at most"
                ),
                remedy="widen the range, or move less",
            )


def _moving(spans: Sequence[tuple[int, int]], command: Array) -> list[tuple[int, int]]:
    """Those `spans` of rows, first and last, in which a `command` (n,) moves."""
    return [(a, b) for a, b in spans if np.ptp(command[a : b + 1]) > MOVED]


def _still(value: Array) -> Iterator[tuple[int, int]]:
    """Yield first and last row of every stretch in which a column (n,) is constant."""
    edges = np.flatnonzero(np.diff(value, prepend=np.nan, append=np.nan) != 0.0)
    return ((a, b - 1) for a, b in pairwise(edges.tolist()) if b - 1 > a)


def complaints(tables: Mapping[str, Mapping[str, Array]]) -> Iterator[Finding]:
    """Findings on the recorded tables of one run, given by file name as columns (n,) by
    name.
    """
    for file, columns in tables.items():
        t = columns.get("t")
        if t is None or len(t) < 3:
            continue
        if file == PROFILE:
            yield from images(t)
            continue
        yield from clock(t)
        for name, value in columns.items():
            if name not in SPARSE_COLUMNS and not name.endswith("_cmd"):
                yield from values(name, t, value, columns.get(f"{name}_cmd"))


def unwrapped(t: Array, values: Array, origin: str) -> tuple[Array, list[int]]:
    """Angles (m,) [rad] at times `t` (m,) without turns between rows, and the rows of
    these.

    Every step is held against those about it. Raises ConfigurationError, with the row,
    for one that no joint makes and no turn explains, and for angles that seem to be in
    degrees, or times not in seconds.
    """
    from scipy.ndimage import median_filter  # strips do without

    rows = np.flatnonzero(np.isfinite(values))
    known = t[rows], values[rows]
    _check_angles(*known, origin)
    spans, steps = np.diff(known)
    turns = np.round(steps / TURN)
    rates = (steps - TURN * turns) / spans
    about = median_filter(rates, NEIGHBOURS, mode="nearest")
    usual = median_filter(np.abs(rates), NEIGHBOURS, mode="nearest")
    step = np.median(spans)
    later = rows[1:]
    leaps = np.abs(rates - about) * np.minimum(spans, step)
    beyond = leaps > np.maximum(LEAP, LEAPS * usual * step)
    if beyond.any():
        leap = np.argmax(beyond)
        row = later[leap]
        changed = later[:leap][steps[:leap] != 0.0]
        since = max(changed, default=0)
        stands = row - since > NEIGHBOURS
        stood = f"stands still from row {since} on and " if stands else ""
        raise ConfigurationError(
            f"{origin}: {stood}jumps by {steps[leap]:.3g} rad at row {row}"
            f" ({t[row]:.2f} s), as no joint moves, and by no whole turn; mend the"
            " reading there, or leave the run out"
        )
    found = values.copy()
    found[later] -= TURN * np.cumsum(turns)
    return (found if turns.any() else values), later[turns != 0.0].tolist()


def _check_angles(t: Array, x: Array, origin: str) -> None:
    """Refuse angles (m,) that seem to be in degrees, or at times `t` (m,) not in
    seconds.
    """
    farthest = np.abs(x).max()
    if farthest > FAR:
        raise ConfigurationError(
            f"{origin}: reaches {farthest:.0f}; angles are in rad (degrees / 57.3,"
            " counts / 652 of 4096 a turn)"
        )
    speed = np.quantile(np.abs(np.gradient(x, t)), 0.9)
    if speed > FAST:
        raise ConfigurationError(
            f"{origin}: changes by {speed:.0f} rad/s; angles are in rad, t is in s"
        )
