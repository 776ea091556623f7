"""Measured runs of a mechanism: read, checked, and averaged into the samples that are compared."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.blocks import PER_BLOCK, blocks
from cell.gap.subject.mechanism.file import MechanismFile
from cell.gap.subject.run_folders import (
    HEADER_FILE,
    JOINT_TABLE,
    RunFolder,
    check_schema,
    check_time,
    column,
    index_of,
    read_table,
)
from cell.gap.subject.subject import Samples, Words
from drivers.errors import ConfigurationError
from drivers.settings import read_yaml
from drivers.types import Array, frozen

ROWS = 5_000_000  # of a table; more is a mistake, or must be thinned
MOST_READINGS = 4000  # readings of a run that are used
JUMP = 50.0  # median steps in one: the clock jumped
FAST, FAR = 200.0, 100.0  # rad/s and rad that no joint of an arm reaches


@dataclass(frozen=True, slots=True)
class Recording:
    """Measured columns (m,) of a run by name over `t` (m,) from 0 [s], NaN where absent.

    `sigma` is the noise of its readings, `rates` are those of the compared positions at its start,
    where the run states them itself.
    """

    name: str
    condition: str
    index: int
    t: Array
    columns: Mapping[str, Array]
    load: Mapping[str, Any] | None = None
    sigma: float | None = None
    rates: Array | None = None


@dataclass(frozen=True, slots=True)
class Signal:
    """A compared column: the quantity by which gaps are shown, noise, place in the chain (`zone`),
    and the joint whose encoder or motor it belongs to (-1: none). Signals of one `group` are shown
    as one.
    """

    name: str
    kind: str
    sigma: float
    zone: str
    joint: int
    floor: float = 0.0
    group: str = ""

    @property
    def channel(self) -> str:
        """Name by which the signal is shown."""
        return self.group or self.name

    @property
    def label(self) -> str:
        """Name of the signal where it is drawn."""
        return f"{self.group} {self.name}".strip()


@dataclass(frozen=True, slots=True)
class Cut:
    """Readings of a run: times `t` (k,) [s], `values` (signals, k), `edges` (b + 1,) of samples."""

    t: Array
    values: Array
    edges: NDArray[np.int64]


def read_recording(folder: RunFolder, file: MechanismFile, hinges: Sequence[str]) -> Recording:
    """The recording in a run folder; raises ConfigurationError, in one line, for a broken one."""
    path = folder.path / HEADER_FILE
    head = read_yaml(path)
    _check_head(head, path, file)
    index = index_of(head, path)
    path = folder.path / "signals.parquet"
    if file.cell and not path.is_file():
        path = folder.path / JOINT_TABLE
        table = arm_columns(path)
    else:
        table = read_table(path)
    if "t" not in table:
        raise ConfigurationError(f"{path}: t: this column is missing (or not numbers); add it")
    t = table["t"]
    if len(t) > ROWS:
        raise ConfigurationError(f"{path}: has {len(t)} rows, at most {ROWS} are read; thin them")
    check_time(t, path, least=20)
    steps = np.diff(t)
    if steps.max() > JUMP * np.median(steps):
        row = int(np.argmax(steps)) + 1
        raise ConfigurationError(
            f"{path}: t: jumps by {steps.max():g} s at row {row} (steps of {np.median(steps):g} s);"
            " the clock was set or rows are lost: cut the run there"
        )
    for name in (*file.signals, *file.inputs):
        if name not in table:
            raise ConfigurationError(f"{path}: {name}: this column is missing; add it")
        if not np.isfinite(table[name]).any():
            raise ConfigurationError(f"{path}: {name}: holds no number; leave the run out")
    angles = [n for n in file.inputs if file.inputs[n] == "position" and n in hinges]
    angles += [n for n, s in file.signals.items() if s.is_ == "position" and s.joint in hinges]
    for name in angles:
        check_angle(t, table[name], path, name)
    # slices of one recording are no repeats of each other: they stay together as one condition
    condition = str(head.get("origin", head.get("condition", folder.name)))
    kept = {n: frozen(v) for n, v in table.items() if n != "t"}
    load = head.get("load")
    if load is not None and not isinstance(load, dict):
        raise ConfigurationError(
            f"{folder.path / HEADER_FILE}: load: is {load!r}; give body, mass, com"
        )
    return Recording(folder.name, condition, index, frozen(t - t[0]), kept, load)


def arm_columns(path: Path) -> dict[str, Array]:
    """Columns (m,) of a robot's joints as a mechanism's: `joint1` [rad], `torque1` [N m],
    `tracking1` [rad], and so on. Raises ConfigurationError for a table that lacks one.
    """
    if not path.is_file():
        raise ConfigurationError(
            f"{path}: is missing; folds by `cell fold --arm fci` hold it, others do not"
        )
    table = read_table(path)
    found = {"t": column(table, "t", path)}
    for i in range(1, 8):
        q, commanded = column(table, f"q_{i}", path), column(table, f"q_d_{i}", path)
        found |= {f"joint{i}": q, f"tracking{i}": q - commanded,
                  f"torque{i}": column(table, f"tau_J_{i}", path)}  # fmt: skip
    return found


def _check_head(head: Mapping[str, Any], path: Path, file: MechanismFile) -> None:
    check_schema(head, path)
    name = head.get("mechanism")
    if name != file.name and not (file.cell and name is None):
        raise ConfigurationError(
            f"{path}: mechanism: is {name!r}, but the file describes {file.name}; give runs of "
            "one mechanism and its file"
        )


def check_angle(t: Array, values: Array, path: Path, name: str) -> None:
    """Refuse angles (m,) that are in degrees, or at times (m,) that are not in seconds."""
    some = np.isfinite(values)
    x = values[some]
    if np.abs(x).max() > FAR:
        raise ConfigurationError(
            f"{path}: {name}: reaches {np.abs(x).max():.0f}; angles are in rad (degrees / 57.3)"
        )
    speed = float(np.quantile(np.abs(np.gradient(x, t[some])), 0.9))
    if speed > FAST:
        raise ConfigurationError(
            f"{path}: {name}: changes by {speed:.0f} rad/s; angles are in rad, t is in s"
        )


def repeat_noise(found: Sequence[Recording], column: str, origin: str) -> float:
    """One-sigma noise of a column from repeats of a condition; ConfigurationError without any."""
    squares = []
    for i, a in enumerate(found):
        for b in found[i + 1 :]:
            if a.condition == b.condition:
                other = np.interp(a.t, b.t, b.columns[column])
                squares.append(np.nanmean((a.columns[column] - other)[a.t <= b.t[-1]] ** 2) / 2.0)
    if not squares:
        raise ConfigurationError(
            f"{origin}: signals.{column}.sigma: repeats: no two runs share a condition; state it"
        )
    return float(max(np.sqrt(np.mean(squares)), 1e-12))


def pace(found: Sequence[Recording], columns: Sequence[str]) -> float:
    """Typical angular frequency [rad/s] of the fastest of the columns: rms rate over rms value."""
    fast = []
    for name in columns:
        pairs = [_rms(r.t, r.columns[name]) for r in found]
        value, rate = np.sqrt(np.mean(np.square(pairs), axis=0))
        fast.append(rate / value if value > 0.0 else 0.0)
    return float(np.clip(max(fast, default=1.0), 0.5, 200.0))


def _rms(t: Array, x: Array) -> tuple[float, float]:
    """Spread of a column and of its rate, noise damped by a moving mean."""
    some = np.isfinite(x)
    t, x = t[some], x[some]
    width = max(1, len(x) // 400)
    tm = t[: len(t) // width * width].reshape(-1, width).mean(axis=1)
    xm = x[: len(x) // width * width].reshape(-1, width).mean(axis=1)
    return float(xm.std()), float(np.gradient(xm, tm).std()) if len(xm) > 2 else 0.0


def width_of(recording: Recording, least: float) -> float:
    """Width of the samples of a run [s]: `least`, or more where it has too many readings."""
    return max(least, float(recording.t[-1]) * PER_BLOCK / MOST_READINGS)


def cut(recording: Recording, columns: Sequence[str], width: float) -> Cut:
    """Average readings into samples of `width` [s]; those with an absent column are left out."""
    whole = np.array([recording.columns[c] for c in columns])
    good = np.flatnonzero(np.isfinite(whole).all(axis=0))
    edges, inside = blocks(recording.t[good], width)
    return Cut(frozen(recording.t[good[inside]]), frozen(whole[:, good[inside]]), edges)


def phases(speed: Array) -> Words:
    """Phase of each sample (b,) of a motion of this signed `speed` (b,)."""
    still = np.abs(speed) < 0.05 * np.sqrt(np.mean(speed**2) + 1e-300)
    return np.where(still, "hold", np.where(speed > 0.0, "carry", "return"))


def falls(height: Array, edges: NDArray[np.int64]) -> Words:
    """Phase of each sample (b,): `fall` where a motion loses `height` (k,) in it, else `return`."""
    return np.where(height[edges[1:] - 1] < height[edges[:-1]], "fall", "return")


def samples(signals: Sequence[Signal], made: Cut, phase: Words) -> Samples:
    """Samples of all signals, signal by signal; `phase` (b,) is the motion's phase in each."""
    k, n = len(made.edges) - 1, len(signals)
    counts = np.diff(made.edges)
    channel = np.repeat(np.array([s.channel for s in signals]), k)
    middle = np.add.reduceat(made.t, made.edges[:-1]) / counts
    sigma = np.array([s.sigma for s in signals])
    # the error of a torque is ripple, supply and constants, which a mean does not make smaller
    readings = np.where([[s.kind == "torque"] for s in signals], 1.0, np.sqrt(counts))
    return Samples(
        channel=channel,
        phase=np.tile(phase, n),
        zone=np.repeat(np.array([s.zone for s in signals]), k),
        quantity=channel,
        t=np.tile(middle, n),
        noise=(sigma[:, None] / readings).ravel(),
        reading=np.repeat(sigma, k),
        floor=np.repeat(np.array([s.floor for s in signals]), k),
        series=np.repeat(np.arange(n), k),
    )
