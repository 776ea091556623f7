"""Checks of a recording by itself, before any model is fitted to it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.types import Array

Level = Literal["bad", "fair"]
SPARSE_COLUMNS = frozenset({"t", "contact_x", "contact_t", "pitch", "f_x", "f_z"})
"""Columns that hold numbers in some rows alone, or need not be there (formats.md)."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Thresholds of complaints about a recording; pairs are (worth a remark, not to be fitted).

    Shares of the rows that were `lost` or hold no number, and of the `images`; a reading that
    stands still for `stuck` [s] while its command changes by `moved` [m or rad]; a largest or
    smallest value that readings keep for `clipped` [s], more than once; steps of the clock whose
    middle half differs by a share `uneven`. Assumed: no fault was measured; runs of the twin and
    recordings of real pendulums stay within.
    """

    lost: tuple[float, float] = (0.02, 0.3)
    images: tuple[float, float] = (0.1, 0.6)
    stuck: float = 0.2
    moved: float = 0.01
    clipped: float = 0.05
    uneven: float = 0.5


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True, slots=True)
class Complaint:
    """Something wrong with a recording: `bad` forbids a fit, `fair` costs accuracy.

    `what` is the check, `words` say what is seen where, `remedy` what to do.
    """

    level: Level
    what: str
    words: str
    remedy: str


def clock(t: Array, limits: Limits = DEFAULT_LIMITS) -> Iterator[Complaint]:
    """Complaints about row times (n,) [s]: missing rows and uneven steps."""
    steps = np.diff(t)
    step = float(np.median(steps))
    if not (steps > 0.0).all():  # the reader refuses rows out of order
        return
    missing = np.round(np.maximum(steps / step - 1.0, 0.0))
    lost = float(missing.sum() / (missing.sum() + len(t)))
    if lost > limits.lost[0]:
        at = int(np.argmax(steps))
        yield Complaint(
            _level(lost, limits.lost), "lost samples",
            f"{100 * lost:.0f} % of the rows are missing, the longest gap {steps[at]:.2g} s at "
            f"{t[at]:.2f} s", "record on a machine that keeps up, or leave the run out",
        )  # fmt: skip
    low, high = np.quantile(steps, [0.25, 0.75])
    if high - low > limits.uneven * step:
        yield Complaint(
            "fair", "clock",
            f"half of the steps between rows lie between {1e3 * low:.2g} and {1e3 * high:.2g} ms, "
            "the others beyond", "stamp a reading when it is made, not when it arrives",
        )  # fmt: skip


def images(t: Array, limits: Limits = DEFAULT_LIMITS) -> Iterator[Complaint]:
    """Complain where images are missing, judged by gaps in the stamps `t` (n,) [s] of images.

    A stamp may repeat: each point of a profile bears that of its image.
    """
    stamps = np.unique(t)
    if len(stamps) < 3:
        return
    steps = np.diff(stamps)
    missing = np.round(np.maximum(steps / np.median(steps) - 1.0, 0.0)).sum()
    lost = float(missing / (missing + len(stamps)))
    if lost > limits.images[0]:
        yield Complaint(
            _level(lost, limits.images), "lost images",
            f"{100 * lost:.0f} % of the images are missing",
            "look at light and segmentation where they are, or leave the run out",
        )  # fmt: skip


def values(
    name: str, t: Array, value: Array, command: Array | None = None, limits: Limits = DEFAULT_LIMITS
) -> Iterator[Complaint]:
    """Complaints about a column (n,) over times `t` (n,) [s]: gaps, stuck and clipped readings.

    A reading is stuck that stands still while its `command` (n,) changes.
    """
    seen = np.isfinite(value)
    lost = 1.0 - float(seen.mean())
    if lost > limits.lost[0]:
        yield Complaint(
            "fair", "lost samples", f"{name} holds no number in {100 * lost:.0f} % of the rows",
            "mend the reading, or leave the run out",
        )  # fmt: skip
    if seen.sum() < 2:
        return
    stuck = None if command is None else _stall(name, t, value, command, limits)
    if stuck is not None:
        yield stuck
        return
    yield from _saturation(name, t, value, limits)


def _stall(name: str, t: Array, value: Array, command: Array, limits: Limits) -> Complaint | None:
    """Complaint about a reading that stands still while its command changes, None if none does."""
    for first, last in _still(value):
        change = float(np.ptp(command[first : last + 1]))
        if t[last] - t[first] > limits.stuck and change > limits.moved:
            return Complaint(
                "bad", "stuck reading",
                f"{name} stands still at {value[first]:.4g} from {t[first]:.2f} to {t[last]:.2f} s "
                f"while its command moves by {change:.2g}", "mend the reading; leave the run out",
            )  # fmt: skip
    return None


def _saturation(name: str, t: Array, value: Array, limits: Limits) -> Iterator[Complaint]:
    """Complaints about a reading that stands repeatedly at its largest or smallest value."""
    for limit, word in ((np.nanmax(value), "largest"), (np.nanmin(value), "smallest")):
        ends = [(a, b) for a, b in _still(value) if value[a] == limit and a > 0 and b < len(t) - 1]
        long = [t[b] - t[a] for a, b in ends if t[b] - t[a] > limits.clipped]
        if len(long) > 1:
            yield Complaint(
                "fair", "saturation",
                f"{name} stands {len(long)} times at its {word} value {limit:.4g}, for "
                f"{max(long):.2g} s at most", "widen the range, or move less",
            )  # fmt: skip


def _still(value: Array) -> Iterator[tuple[int, int]]:
    """First and last row of every stretch in which a column (n,) has one and the same value."""
    edges = np.flatnonzero(np.diff(value) != 0.0)
    first = np.concatenate([[0], edges + 1])
    last = np.concatenate([edges, [len(value) - 1]])
    return ((int(a), int(b)) for a, b in zip(first, last, strict=True) if b > a)


def _level(lost: float, limits: tuple[float, float]) -> Level:
    return "bad" if lost > limits[1] else "fair"


def complaints(
    tables: Mapping[str, Mapping[str, Array]], limits: Limits = DEFAULT_LIMITS
) -> Iterator[Complaint]:
    """Complaints about a run's `tables`: by file name, columns (n,) by name."""
    for file, columns in tables.items():
        t = columns.get("t")
        if t is None or len(t) < 3:
            continue
        if file == "profile.parquet":
            yield from images(t, limits)
            continue
        yield from clock(t, limits)
        for name, value in columns.items():
            if name not in SPARSE_COLUMNS and not name.endswith("_cmd"):
                command = columns.get(f"{name}_cmd")
                yield from values(name, t, value, command, limits)
