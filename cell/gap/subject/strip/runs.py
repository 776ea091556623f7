"""Reads measured folds, checks them, and reduces them to the quantities that are
compared.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from cell.gap.subject.run_folders import RunFolder, check_indices
from cell.gap.subject.strip.contradictions import contradictions
from cell.gap.subject.strip.preprocessing import (
    Midlines,
    images_of,
    smooth_path,
)
from cell.orchestrator.monitors import is_outcome
from cell.record.files import PROFILE, RESULT, RUN, TICKS, is_under_way
from cell.record.header import NOT_FOLDED, Header, Sigma
from cell.record.run import Run, read_run
from cell.record.tables import check_clock
from drivers.base.errors import ConfigurationError, suggestion
from drivers.base.geometry import arc_lengths, interpolate_columns
from drivers.base.readers import read_yaml
from drivers.base.types import Array, frozen
from drivers.strip.engine import Touch
from drivers.strip.file import StripFile
from policies.path import lift_pitch

WORST_SIGMA, BEST_SIGMA = 0.05, 1e-7  # m, no instrument of a cell is worse or better
WORST_TIME, BEST_TIME = 1.0, 1e-6  # s
LENGTHS = ("contact_x", "profile", "gripper", "displacement")  # with a noise in metres
FASTEST_GRIPPER = 5.0  # m/s, faster than any arm
FASTEST_TURN = 30.0  # rad/s, faster than any arm
SHORTEST_INTERVAL = 0.01  # s, over shorter times noise looks like speed
# standard deviations of noise by which positions may differ without motion
JUMP_SIGMAS = 10
# the touch is a measurement, whatever came after it
TOUCHED = NOT_FOLDED | {"layer_touch"}
# of a strip's length, by which midlines begin elsewhere after a touch; images in which
# they do
JUMPED, PERSISTS = 0.08, 3
LEAST = 30  # rows of a usable run
FEWEST_RUNS = 2  # that can be fitted and checked


def _check_noise(origin: Path, run: Run) -> None:
    """Raise ConfigurationError where a run states a noise of a measured quantity that
    no instrument of a cell has.
    """
    sigma = run.header.sigma
    limits = dict.fromkeys(LENGTHS, (BEST_SIGMA, WORST_SIGMA, "m"))
    limits["touch_time"] = BEST_TIME, WORST_TIME, "s"
    for key, (best, worst, unit) in limits.items():
        value = getattr(sigma, key)
        if key not in sigma.model_fields_set or value is None or best <= value <= worst:
            continue
        limit = f"at most {worst:g}" if value > worst else f"at least {best:g}"
        raise ConfigurationError(
            f"{origin}: sigma.{key}: is {value:g} {unit}, {limit} {unit} is believable;"
            f" give it in {unit}, as repeated readings scatter"
        )


def _check_motion(origin: Path, run: Run) -> None:
    """Raise ConfigurationError where poses of a run jump between successive rows, as
    they do where rows are not sorted by time.
    """
    ticks = run.ticks
    if len(ticks.t) < 2:
        return

    span = np.maximum(np.diff(ticks.t), SHORTEST_INTERVAL)
    noise = JUMP_SIGMAS * run.header.sigma.gripper
    for names, fastest, apart, unit in (
        (("x", "z"), FASTEST_GRIPPER, noise, "m"),
        (("x_cmd", "z_cmd"), FASTEST_GRIPPER, noise, "m"),
        (("pitch",), FASTEST_TURN, 0.0, "rad"),
    ):
        steps = np.linalg.norm(np.diff([getattr(ticks, n) for n in names]), axis=0)
        jumps = np.flatnonzero(steps > fastest * span + apart)
        for first in jumps[:1]:
            raise ConfigurationError(
                f"{origin}: {', '.join(names)}: {len(jumps)} rows jump, row {first + 1}"
                f" by {steps[first]:.3g} {unit}, as no arm moves; sort all columns by"
                " t, or leave wrong rows out"
            )


def _check_indices(folders: Sequence[RunFolder], heads: Sequence[Header]) -> None:
    """Raise ConfigurationError where two of the runs in `folders` that belong to one
    batch have the same index.

    `cell fold --repeat` and `cell gap plan` number the folds of one specimen from 0,
    with seeds that grow as the index does; several such batches of the twin are several
    specimens.
    """
    batches: dict[str, list[tuple[Path, int | None]]] = {}
    for folder, header in zip(folders, heads, strict=True):
        batches.setdefault(_batch_key(header), []).append((folder.path, header.index))
    for batch in batches.values():
        check_indices([path for path, _ in batch], [index for _, index in batch])


def _batch_key(header: Header) -> str:
    """Text that is equal for folds of one batch: on the simulated cell it names the
    command that made them, else it is empty.
    """
    drivers = header.drivers
    if drivers is None or drivers.arm != "twin" or header.seed is None:
        return ""
    return f"{header.plant_sha256} {header.seed - (header.index or 0)}"


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """Measured fold, reduced to what is compared with simulations: the gripper's path
    and the measurements of the strip, in SI units.

    `t` (m,), `poses` (m, 3) the gripper path, smoothed; `travel` (m,) along it.
    `contact_t`, `contact_x` (k,). `force_t` (f,), `force` (f, 2) of the strip on the
    gripper along x and z, NaN where it was not measured. `end` [s] is where comparison
    ends: the touch, or the last row. `plane_error` [m] is that of the camera that
    measured the fold. `notes` are for the operator.
    """

    name: str
    condition: str
    t: Array
    poses: Array
    travel: Array
    hanging: bool
    index: int
    contact_height: float
    sigma: Sigma
    contact_t: Array
    contact_x: Array
    images: Midlines
    force_t: Array
    force: Array
    touch: Touch | None
    end: float
    plane_error: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def has_force(self) -> bool:
        """Whether the run holds the force of the strip on the gripper, with a stated
        noise.
        """
        return self.sigma.force is not None and len(self.force_t) > 0

    @property
    def usable(self) -> bool:
        """Whether the run is long enough to be compared with simulations at all."""
        return len(self.t) > 0

    @property
    def shows_strip(self) -> bool:
        """Whether the run is usable and holds any measurement of the strip besides the
        gripper's path.
        """
        seen = len(self.contact_x) + len(self.force_t) + len(self.images.stamps)
        return self.usable and (seen > 0 or self.touch is not None)


def read_runs(folders: Sequence[RunFolder], strip: StripFile) -> list[MeasuredRun]:
    """Measured folds in `folders`, sorted by their index and name; those that are too
    short have `usable` false.

    Raises ConfigurationError, in one line, for input that is broken or too little.
    """
    folds = [_read_fold(folder.path, folder.name, strip) for folder in folders]
    runs = [run for _, run in folds]
    usable = [i for i, run in enumerate(runs) if run.usable]
    _check_indices([folders[i] for i in usable], [folds[i][0] for i in usable])
    _check_enough(runs, folders[0].path.parent)
    return sorted(runs, key=lambda run: (run.index, run.name))


def _check_enough(runs: Sequence[MeasuredRun], origin: Path) -> None:
    """Raise ConfigurationError where fewer runs than a fit needs are usable, or where
    fewer show the strip.
    """
    usable = sum(run.usable for run in runs)
    if usable < FEWEST_RUNS:
        raise ConfigurationError(
            f"{origin}: {usable} of {len(runs)} runs can be used; at least two are "
            "needed, better ten"
        )
    if sum(run.shows_strip for run in runs) < FEWEST_RUNS:
        raise ConfigurationError(
            f"{origin}: the gripper's path alone says nothing of the strip; fold until"
            " the layers touch (the motion `normal`) and note when and where"
            " (t_layer_touch, l1, l2), or add profile, contact or force; see"
            " runbooks/own-runs.md"
        )


def _read_fold(folder: Path, name: str, strip: StripFile) -> tuple[Header, MeasuredRun]:
    """Header and measured fold of the run in `folder`; ConfigurationError where these
    contradict the file of the `strip`.
    """
    try:
        recorded = read_run(folder)
    except ConfigurationError as error:
        _check_kind(folder)
        raise ConfigurationError(str(error).splitlines()[0]) from None

    header = recorded.header
    result = recorded.result
    if result is None and is_under_way(folder):
        raise ConfigurationError(f"{folder}: is still under way; let it finish")
    if header.strip != strip.name:
        raise ConfigurationError(
            f"{folder / RUN}: strip: is {header.strip!r}, the strip file"
            f" describes {strip.name!r}; give runs of one strip and its file"
        )
    if result is not None and not is_outcome(result.outcome):
        raise ConfigurationError(
            f"{folder / RESULT}: outcome: is {result.outcome!r}; allowed:"
            " layer_touch, path_done, or the name of a fault as `cell fold` writes it"
        )

    _check_noise(folder / RUN, recorded)
    _check_motion(folder / TICKS, recorded)
    touch = _touch(folder, recorded)
    if (n := len(recorded.ticks.t)) >= LEAST:
        notes = tuple(_notes(folder, name, run=recorded, touch=touch, strip=strip))
        run = replace(_measured_run(name, recorded, touch, strip), notes=notes)
        return header, _until_touch(run, strip.length)
    if result is not None:
        raise ConfigurationError(
            f"{folder / TICKS}: t: has {n} rows; at least {LEAST} are needed"
        )

    return header, _short_run(name, header, f"has {n} rows only and is left out")


def check_fold(
    known: Collection[str], load: Callable[[str], StripFile], folder: Path
) -> tuple[str, ...]:
    """Remarks on the run in `folder`, which is checked against the file of its strip;
    ConfigurationError where it contradicts that.

    `load` reads a strip by its name, if it is `known`.
    """
    strip = read_run(folder).header.strip
    if strip not in known:
        guess = suggestion(strip, known)
        return (f"{folder.name}: strip {strip!r} is not known{guess}: no check",)
    return _read_fold(folder, folder.name, load(strip))[1].notes


def _pitch(run: Run) -> Array:
    """Pitch [rad] of the gripper in each row of a run: as recorded, else upright for a
    hanging start, or that of a lift from the desk.
    """
    ticks = run.ticks
    if np.isfinite(ticks.pitch).any():
        return ticks.pitch
    if run.header.start == "hanging":
        return np.full(len(ticks.t), np.pi / 2)
    return lift_pitch(arc_lengths(np.column_stack([ticks.x, ticks.z])))


def _check_kind(folder: Path) -> None:
    """Raise ConfigurationError where `folder` holds the run of a pendulum, for the run
    of a strip is needed.
    """
    head = read_yaml(folder / RUN)
    if "strip" not in head and "pendulum" in head:
        raise ConfigurationError(
            f"{folder / RUN}: strip: is missing, this is a run of the pendulum "
            f"{head['pendulum']}; give its mechanism file by --model, or runs of the"
            " strip"
        )


def _measured_run(
    name: str, run: Run, touch: Touch | None, strip: StripFile
) -> MeasuredRun:
    """Measured fold called `name`, reduced from the tables of its recorded `run` to the
    arrays with which simulations are compared.
    """
    ticks = run.ticks
    header = run.header
    profile = run.profile
    rows = ticks.t
    sigma = header.sigma
    note = header.calibration if header.by_cell else None
    poses = np.stack([ticks.x, ticks.z, _pitch(run)], axis=1)
    t, smooth = smooth_path(rows, poses, sigma.gripper)
    grip = interpolate_columns(profile.t, rows, poses[:, :2])
    contact_t, contact_x = ticks.contacts()
    force = np.stack([ticks.f_x, ticks.f_z], axis=1)
    reported = np.isfinite(force).any(axis=1)
    return MeasuredRun(
        name=name,
        condition=header.condition or name,
        t=t,
        poses=smooth,
        travel=frozen(arc_lengths(smooth[:, :2])),
        hanging=header.start == "hanging",
        index=header.index or 0,
        contact_height=header.contact_height,
        sigma=sigma,
        contact_t=contact_t,
        contact_x=contact_x,
        images=images_of(profile, grip, strip.length, sigma.profile),
        force_t=frozen(rows[reported]),
        force=frozen(force[reported]),
        touch=touch,
        end=float(rows[-1]) if touch is None else touch.time,
        plane_error=None if note is None else note.error or 0.0,
    )


def _until_touch(run: MeasuredRun, length: float) -> MeasuredRun:
    """Copy of a run without a measured touch of the layers, cut where its midlines
    suddenly begin elsewhere, as they do after a touch that nobody saw.

    Where layers lie on each other an image shows the upper one alone. Before, and with
    the gripper past the middle of a strip of `length` [m], the place where midlines
    begin moves by less than half as much from one image to the next.
    """
    stamps, _, image, s = run.images
    _, first = np.unique(image, return_index=True)
    if run.touch is not None or len(first) <= PERSISTS:
        return run

    begins = s[first]
    later = np.median(sliding_window_view(begins[1:], PERSISTS), axis=1)
    count = len(later)
    moved = np.abs(later - begins[:count])
    past = np.interp(stamps[:count], run.t, run.poses[:, 0]) < 0.5 * length
    jumps = (moved > JUMPED * length) & past
    if not jumps.any():
        return run

    k = int(np.argmax(jumps))
    end = float(stamps[k])
    note = (
        f"{run.name}: after {end:.2f} s its midlines begin {1e3 * moved[k]:.0f} mm"
        " elsewhere, as where layers touched: it is used up to there"
    )
    return replace(run, end=end, notes=(*run.notes, note))


def _short_run(name: str, header: Header, why: str) -> MeasuredRun:
    """Run called `name` without any measurements, for a recorded one that is too short
    to be used, with `why` as its note.
    """
    none = frozen([])
    return MeasuredRun(
        name=name,
        condition=header.condition or name,
        t=none,
        poses=np.empty((0, 3)),
        travel=none,
        hanging=False,
        index=header.index or 0,
        contact_height=header.contact_height,
        sigma=header.sigma,
        contact_t=none,
        contact_x=none,
        images=Midlines.of([], [], []),
        force_t=none,
        force=np.empty((0, 2)),
        touch=None,
        end=0.0,
        notes=(f"{name}: {why}",),
    )


def _notes(
    folder: Path, name: str, run: Run, touch: Touch | None, strip: StripFile
) -> Iterator[str]:
    """Yield remarks on a recorded fold whose data contradict a strip that is held at
    its end, or which ended without a touch of the layers.

    A run that ended without a touch is noted, too. Raises ConfigurationError where
    places contradict such a strip, or stamps lie beside the gripper's rows.
    """
    t = run.ticks.t
    result = run.result
    check_clock(run.ticks.contact_t, t, f"{folder / TICKS}: contact_t")
    check_clock(run.profile.t, t, f"{folder / PROFILE}: t")

    for file, what, off, limits in contradictions(run, touch, strip):
        if not np.size(off):
            continue

        usual = min(limits)
        most = max(limits)
        median = float(np.median(off))
        seen = f"{what} {median:.2g}, at most"
        if median > most:
            raise ConfigurationError(
                f"{folder / file}: {seen} {most:g} is believable; give m, rad and s, x"
                " along the strip from its fixed edge"
            )

        if median > usual:
            yield (
                f"{name}: {seen} {usual:g} is usual; are columns swapped, or `start`,"
                " `offset` or `late` of the mapping wrong?"
            )

    if result is None:
        yield f"{name}: died after {t[-1]:.1f} s and is used as far as it goes"
    elif result.outcome not in TOUCHED | {"path_done"}:
        yield f"{name}: ended with {result.outcome} and is used as far as it goes"


def _touch(folder: Path, run: Run) -> Touch | None:
    """Measured touch of the strip's layers in a run, or None where it has none;
    ConfigurationError where its time lies outside the run.
    """
    result = run.result
    if result is None or result.outcome not in TOUCHED:
        return None

    time = result.t_layer_touch
    l1 = result.l1
    l2 = result.l2
    if time is None or l1 is None or l2 is None or result.displacement is None:
        return None

    check_clock(
        frozen([time]), run.ticks.t, f"{folder / RESULT}: t_layer_touch", before=0.0
    )
    return Touch(time, x=l2, to_grasped=l1, to_fixed=l2)
