"""Reads and checks recordings of a mechanism, and averages them into samples."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.mechanism.mechanism_file import MechanismFile
from cell.gap.subject.run_folders import RunFolder
from cell.gap.subject.run_table import clock_of, column, read_table, unwrapped
from cell.gap.subject.subject import Samples, Series, Words
from cell.record.files import ANGLES, JOINTS, RUN, SIGNALS
from cell.record.header import Load, MechanismRun
from cell.report.words import plural
from drivers.base.errors import ConfigurationError
from drivers.base.settings import load
from drivers.base.types import Array, frozen

PER_BLOCK = 16  # readings used of a block at most
MOST_READINGS = 4000  # readings of a run that are used
SWING_ROWS, SIGNAL_ROWS = 30, 20  # least of a run
SMALLEST_NOISE = 1e-12  # in SI, of repeats that agree in every digit
SLOWEST_PACE, FASTEST_PACE = 0.5, 200.0  # rad/s
PACE_READINGS = 400  # means of a column, from which its pace is taken
NOISY = 0.35  # times a column's spread, in a step: half of what white noise changes by
STILL = 0.05  # of the rms speed, below which a motion holds
SLOWEST_CHECKED = 0.1  # rad/s of a swing below which stated rates are not checked


def average(values: Array, edges: NDArray[np.int64]) -> tuple[Array, Array]:
    """Mean and mean square of each row of `values` within each of the blocks between
    `edges`, both flattened row by row to shape (rows times blocks,).
    """
    starts = edges[:-1]
    counts = np.diff(edges)
    mean, square = (
        (np.add.reduceat(x, starts, axis=1) / counts).ravel()
        for x in (values, values**2)
    )
    return mean, square


@dataclass(frozen=True, slots=True)
class Recording:
    """Measured columns of a run by name, each with one number for each time in `t` [s],
    which begins at 0; NaN where nothing was read.

    `sigma` is the noise of its readings, `rates` are those of the compared positions at
    its start, where the run states them itself; `notes` say what was mended.
    """

    name: str
    condition: str
    index: int | None
    t: Array
    columns: Mapping[str, Array]
    load: Load | None = None
    sigma: float | None = None
    rates: Array | None = None
    notes: tuple[str, ...] = ()

    def known(self, name: str) -> tuple[Array, Array]:
        """Times [s] and values of the column `name` where it holds a number, each of
        shape (k,).
        """
        values = self.columns[name]
        is_number = np.isfinite(values)
        return self.t[is_number], values[is_number]

    def poses(self, names: Sequence[str]) -> Array:
        """Values of the columns `names`, of shape (rows, columns), in all rows where
        every one of these holds a number.
        """
        q = np.column_stack([self.columns[name] for name in names])
        return q[np.isfinite(q).all(axis=1)]


@dataclass(frozen=True, slots=True)
class Signal:
    """Column of a run that is compared with a prediction: its `kind` of quantity, such
    as torque, its noise `sigma` in SI units, and the joint or sensor that it is of.

    A torque is read at an actuator, by number, and acts on a joint, with `gear` [N m]
    there for a unit of the reading. A position or rate is the sum of the joints' with
    `weights` (joints,). Of a site or sensor, `joint` is the number of its coordinate
    among all; -1 where there is none. `zone` is where on the chain it is read, `floor`
    [SI] the error that every model has of it. Residuals are grouped and shown by
    `channel`.
    """

    name: str
    channel: str
    kind: str
    sigma: float
    zone: str
    joint: int
    weights: Array
    floor: float
    actuator: int
    gear: float

    @property
    def label(self) -> str:
        """Name under which drawings show the signal, which includes that of its
        channel.
        """
        name = self.name
        channel = self.channel
        return name if channel == name else f"{channel} {name}"


class Cut(NamedTuple):
    """Readings of a run at the times `t` [s], with a row of `values` for each signal,
    cut into samples that last about `width` [s].

    Samples begin and end at `edges` (b + 1,) among the readings.
    """

    t: Array
    values: Array
    edges: NDArray[np.int64]
    width: float

    def keep(self, good: NDArray[np.bool_]) -> "Cut":
        """Copy with only those readings for which the mask `good`, of shape
        (readings,), is true, and without samples that become empty.
        """
        block = np.repeat(np.arange(len(self.edges) - 1), np.diff(self.edges))[good]
        edges = np.append(np.flatnonzero(np.diff(block, prepend=-1)), len(block))
        return Cut(
            t=self.t[good], values=self.values[:, good], edges=edges, width=self.width
        )


def read_recording(
    folder: RunFolder, file: MechanismFile, hinges: Sequence[str]
) -> Recording:
    """Recording in the run folder `folder`; ConfigurationError, with a text of one
    line, where it is broken.
    """
    path = folder.path / RUN
    head = load(path, MechanismRun)
    sigma = head.sigma.angle
    swings = file.mode == "planar"
    kind = "pendulum" if swings else "mechanism"
    name = getattr(head, kind)
    if name != file.name and not (file.cell and name is None):
        raise ConfigurationError(
            f"{path}: {kind}: is {name!r}, but the file describes {file.name}; give"
            f" runs of one {kind} and its file, or its strip file"
        )
    if swings and not sigma:
        raise ConfigurationError(
            f"{path}: sigma.angle: is missing; add the noise in rad"
        )

    if swings:
        read = _swing_table(folder.path / ANGLES, list(file.signals))
    else:
        read = _signal_table(folder.path, file, hinges)
    table, rates, wrapped = read

    # slices of one recording are no repeats of each other: they stay together as one
    # condition
    condition = str(head.origin or head.condition or folder.name)
    t = table.pop("t")
    return Recording(
        name=folder.name,
        condition=condition,
        index=head.index,
        t=frozen(t - t[0]),
        columns={name: frozen(values) for name, values in table.items()},
        load=head.load,
        sigma=sigma,
        rates=rates,
        notes=tuple(wrapped),
    )


Read = tuple[dict[str, Array], Array | None, Sequence[str]]
"""Columns (m,) by name, stated rates at the start, and words on what was mended."""


def _swing_table(path: Path, links: Sequence[str]) -> Read:
    """Angles [rad] of the `links` of a pendulum, measured from where it hangs at rest,
    and their rates at the start where the table states them all.

    The table at `path` holds absolute angles from upright; ConfigurationError for a
    broken one.
    """
    table = read_table(path)
    t = clock_of(table, path, SWING_ROWS)
    angles = {name: column(table, f"theta_{name}", path) for name in links}
    if (after := f"theta_{len(links) + 1}") in table:
        raise ConfigurationError(
            f"{path}: {after}: the pendulum has {len(links)} links only"
        )

    wrapped = _unwrap(angles, t, angles, path)
    found = {"t": t, **{name: angle - np.pi for name, angle in angles.items()}}
    if not all(f"omega_{name}" in table for name in links):
        return found, None, wrapped

    rates = np.array([column(table, f"omega_{name}", path) for name in links])
    _check_rates(np.gradient(list(angles.values()), t, axis=1), rates, path)
    return found, rates[:, 0], wrapped


def _check_rates(slope: Array, rates: Array, path: Path) -> None:
    """Raise ConfigurationError where the stated `rates` [rad/s] differ much from the
    `slope` [rad/s] of the measured angles, of the same shape.
    """
    if np.quantile(np.abs(slope), 0.99) < SLOWEST_CHECKED:
        return
    ratio = (rates * slope).sum() / (slope * slope).sum()
    if not 0.5 < ratio < 2.0:
        raise ConfigurationError(
            f"{path}: omega: is {ratio:.3g} times the rate of theta; t is in s, angles"
            " in rad, rates in rad/s"
        )


def _signal_table(folder: Path, file: MechanismFile, hinges: Sequence[str]) -> Read:
    """Checked columns of the run in `folder`, by name: the times, and all signals and
    inputs that `file` lists.
    """
    path = folder / SIGNALS
    if file.cell and not path.is_file():
        path = folder / JOINTS
        table = _arm_columns(path)
    else:
        table = read_table(path)

    t = clock_of(table, path, SIGNAL_ROWS)
    for name in (*file.signals, *file.inputs):
        if name not in table:
            raise ConfigurationError(f"{path}: {name}: this column is missing; add it")
        if not np.isfinite(table[name]).any():
            raise ConfigurationError(
                f"{path}: {name}: holds no number; leave the run out"
            )

    read: list[tuple[str, str | None, str | None]]
    read = [(n, kind, n) for n, kind in file.inputs.items()]
    read += [(n, s.is_, s.joint) for n, s in file.signals.items()]
    angles = [n for n, kind, of in read if kind == "position" and of in hinges]
    return table, None, _unwrap(angles, t, table, path)


def _arm_columns(path: Path) -> dict[str, Array]:
    """Columns of a mechanism, by name, from the table at `path` that a cell records of
    its robot's joints.

    They are `joint1` [rad], `torque1` [N m], `tracking1` [rad], and so on. Raises
    ConfigurationError for a table that lacks one.
    """
    if not path.is_file():
        raise ConfigurationError(
            f"{path}: is missing; folds by `cell fold --arm fci` hold it, others do not"
        )

    table = read_table(path)
    found = {"t": column(table, "t", path)}
    for i in range(1, 8):
        q = column(table, f"q_{i}", path)
        commanded = column(table, f"q_d_{i}", path)
        found |= {
            f"joint{i}": q,
            f"tracking{i}": q - commanded,
            f"torque{i}": column(table, f"tau_J_{i}", path),
        }

    return found


def _unwrap(
    names: Iterable[str], t: Array, table: dict[str, Array], path: Path
) -> list[str]:
    """Remove jumps by a whole turn from the angles in the columns `names` of `table`,
    and return a sentence on each column that had any.
    """
    found = []
    for name in names:
        column = f"theta_{name}" if path.name == ANGLES else name
        table[name], rows = unwrapped(t, table[name], f"{path}: {column}")
        if rows:
            first = rows[0]
            found.append(
                f"{name} wraps by a turn at {plural(len(rows), 'row')}, first at row"
                f" {first} ({t[first]:.2f} s): it is used without"
            )
    return found


def repeat_noise(found: Sequence[Recording], column: str, origin: str) -> float:
    """Standard deviation of the noise in a `column`, from the differences of repeated
    runs; ConfigurationError where there are none.
    """
    variances = []
    for a, b in combinations(found, 2):
        if a.condition == b.condition:
            other = np.interp(a.t, b.t, b.columns[column])
            past = np.interp(a.t, b.t, np.arange(len(b.t))) % 1.0
            # of a reading and of a mean of two, between which it lies
            errors = 2.0 * (1.0 - past + past**2)
            squares = (a.columns[column] - other) ** 2 / errors
            variances.append(np.nanmean(squares[a.t <= b.t[-1]]))
    if not variances:
        raise ConfigurationError(
            f"{origin}: signals.{column}.sigma: repeats: no two runs share a condition;"
            " state it"
        )
    return float(max(np.sqrt(np.mean(variances)), SMALLEST_NOISE))


def typical_frequency(found: Sequence[Recording], columns: Sequence[str]) -> float:
    """Angular frequency [rad/s] of the fastest of `columns`: the spread of its rate
    divided by the spread of its values.
    """
    frequencies = []
    for name in columns:
        spreads = [_spreads(*r.known(name)) for r in found]
        value, rate = np.sqrt(np.mean(np.square(spreads), axis=0))
        frequencies.append(rate / value if value > 0.0 else 0.0)
    return float(np.clip(max(frequencies, default=1.0), SLOWEST_PACE, FASTEST_PACE))


def _spreads(t: Array, x: Array) -> tuple[float, float]:
    """Standard deviations of `x`, averaged over blocks, and of its rate over the times
    `t` [s]; that of the rate is 0 where it is all noise.
    """
    width = max(1, len(x) // PACE_READINGS)
    whole = len(x) // width * width
    times, means = (a[:whole].reshape(-1, width).mean(axis=1) for a in (t, x))
    spread = means.std()
    rate = np.gradient(means, times).std() if len(means) > 2 else 0.0
    above_noise = rate * np.diff(times).mean() < NOISY * spread
    return spread, rate if above_noise else 0.0


def cut_recording(recording: Recording, columns: Sequence[str], least: float) -> Cut:
    """Cut a run into samples that last `least` [s], or longer where it has too many
    readings.

    Readings in which a column is absent are left out, and of a sample all but
    PER_BLOCK.
    """
    t = recording.t
    width = max(least, t[-1] * PER_BLOCK / MOST_READINGS)
    values = np.array([recording.columns[c] for c in columns])
    good = np.flatnonzero(np.isfinite(values).all(axis=0))
    starts = np.flatnonzero(np.diff(np.floor(t[good] / width))) + 1
    chosen = [_thinned(inside) for inside in np.split(good, starts)]
    edges = np.cumsum([0, *map(len, chosen)])
    kept = np.concatenate(chosen)
    return Cut(
        t=frozen(t[kept]), values=frozen(values[:, kept]), edges=edges, width=width
    )


def _thinned(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Some of the row numbers `rows`, no more than fit into a sample, evenly spaced
    from the first to the last.
    """
    count = min(len(rows), PER_BLOCK)
    chosen = np.linspace(0, len(rows) - 1, count).round().astype(np.int64)
    thinned: NDArray[np.int64] = rows[chosen]
    return thinned


def phases(speed: Array) -> Words:
    """Phase of each sample, as words of shape (samples,), by its signed `speed`:
    `carry` forward, `return` backward, or `hold` at rest.
    """
    still = np.abs(speed) < STILL * np.sqrt(np.mean(speed**2) + 1e-300)
    return np.where(still, "hold", np.where(speed > 0.0, "carry", "return"))


def samples(signals: Sequence[Signal], cut: Cut, phase: Words) -> Samples:
    """Samples of all `signals` of a run that was cut, signal by signal, with the phase
    of each sample in `phase`, of shape (samples,).
    """
    counts = np.diff(cut.edges)
    middle, _ = average(cut.t[None], cut.edges)
    # the error of a torque is ripple, supply and constants, which a mean does not make
    # smaller
    return Samples.stack(
        [
            Series(
                channel=signal.channel,
                quantity=signal.channel,
                phase=phase,
                zone=signal.zone,
                t=middle,
                noise=signal.sigma
                / (1.0 if signal.kind == "torque" else np.sqrt(counts)),
                reading=signal.sigma,
                floor=signal.floor,
            )
            for signal in signals
        ]
    )
