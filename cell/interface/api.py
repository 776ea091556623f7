"""Python interface of the cell, `import cell`: functions like the commands, typed, in
SI units.

Every function raises CellError, of which ConfigurationError is one: `file: key:
reason`, in one line. Paths may be text.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from os import PathLike
from pathlib import Path, PosixPath
from typing import TYPE_CHECKING, Any, get_args

import pyarrow as pa

from calibration.calibration import Calibration, load_calibration
from cell.base.config.places import find_configs
from cell.base.devices.devices import Trial
from cell.folding.feasibility import Prediction, assess
from cell.folding.fold import fold as fold_once
from cell.folding.request import Learning, RecordingOptions, Request, line_at, prepare
from cell.folding.result import FoldResult
from cell.record.columns import Profile, Sights, Ticks, as_frame
from cell.record.exchange.export_runs import Format, export_runs as export_to
from cell.record.exchange.import_runs import import_runs as import_from
from cell.record.files import Keep, run_folder
from cell.record.listing import COLUMNS, RunRow, list_runs as find_runs, values_of
from cell.record.run import read_run as load_run
from cell.report.figures import DrawnRun
from cell.report.runs_page import write_comparison
from cell.setup.calibration_in_use import calibration_of
from drivers.base.errors import ConfigurationError, check_known
from drivers.strip.describe import load_plant
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Effect
from drivers.strip.file import StripFile

if TYPE_CHECKING:  # what takes a second to import is imported where it is used
    from cell.gap.check import CheckReport
    from cell.gap.report.figures import DrawnVerdict
    from cell.gap.verdict.accept import AcceptResult

StrPath = str | Path
# folders, or runs that were read
StrPaths = str | PathLike[str] | Sequence[str | PathLike[str]]


def fold(
    strip: str,
    policy: str = "adaptive",
    *,
    plant: StrPath | None = None,
    arm: str | None = None,
    camera: str | None = None,
    seed: int = 0,
    runs: StrPath = "runs",
    configs: StrPath | None = None,
    speed: float | None = None,
    frames: Keep | None = None,
    truth: bool = True,
    specimen: str | None = None,
    learning: str | None = None,
    at: str | None = None,
) -> FoldResult:
    """Fold a strip once and record the run in a new folder below `runs`, as `cell fold`
    does.

    `strip` is a name, a path to a strip file, or `unknown:0.6` with a length [m];
    `plant` the name or file of another strip on the twin's desk; `speed` [m/s] replaces
    the cell's own. The cell learns from the fold of a `specimen` and corrects it as
    `learning` says: `on`, `off`, `auto`, a length, or None for the cell's own setting.
    It is folded `at` a share of its length from the grasped edge, as `1/3`, or at a
    length, as `200mm`; in half where that is None.
    An error before the motion raises CellError; what happens during it is the result's
    `outcome`. A strip outside an engine's validated range is a UserWarning.
    """
    config = find_configs(configs)
    desk = None if plant is None else load_plant(config.plant_path(str(plant)))
    lying = config.strip(strip)
    if seed < 0:
        raise ConfigurationError(f"seed: is {seed}, must be at least 0")

    cell = config.cell().with_drivers(arm, camera)
    check_known("frames", frames or "key", get_args(Keep))
    record = RecordingOptions(frames, truth=truth)
    asked = Request(
        cell=cell,
        strip=lying,
        policy=policy,
        runs=Path(runs),
        trial=Trial(seed=seed),
        speed=speed,
        record=record,
        learning=Learning(specimen, use=learning),
        at=_line(at, lying),
    )
    (request,) = _prepared(asked, [] if desk is None else [desk])
    return fold_once(request, calibration_of(request.cell))


def predict(
    strip: str,
    policy: str = "adaptive",
    speed: float | None = None,
    configs: StrPath | None = None,
    at: str | None = None,
) -> Prediction:
    """Predict a fold by simulation, as `cell fold --dry-run` does; nothing moves.

    Raises PreflightRefused, with every problem, for one that `fold` would refuse.
    """
    config = find_configs(configs)
    cell = config.cell()
    lying = config.strip(strip)
    line = _line(at, lying)
    asked = Request(
        cell=cell, strip=lying, policy=policy, runs=Path("runs"), speed=speed, at=line
    )
    (request,) = _prepared(asked)
    return assess(request, calibration_of(request.cell)).prediction


def _line(at: str | None, strip: StripFile) -> float | None:
    """Distance [m] of the line `at` which a `strip` is folded from its grasped edge."""
    return line_at("at", () if at is None else (at,), strip.length)


def _prepared(asked: Request, plants: Sequence[StripFile] = ()) -> tuple[Request, ...]:
    """Requests of the folds that are `asked` for, as a command makes them."""
    prepared = prepare(asked, plants)
    for doubt in prepared.doubts:
        warnings.warn(doubt, stacklevel=3)
    return prepared.requests


class ShownPage(PosixPath):
    """Path of an HTML page, which a notebook shows in place."""

    def _repr_html_(self) -> str | None:
        if not self.is_file():
            return None
        text = escape(self.read_text(encoding="utf-8"))
        return f'<iframe srcdoc="{text}" width="100%" height="800"></iframe>'


def compare(runs: StrPaths, out: StrPath = "compare.html") -> ShownPage:
    """Write the HTML page that compares `runs`, as `cell report` does; returns the
    page's path, which a notebook shows in place.
    """
    folders = [run_folder(str(run)) for run in _listed(runs)]
    return ShownPage(write_comparison(folders, Path(out)))


def read_run(folder: StrPath) -> DrawnRun:
    """Read the run in `folder`, a path, the end of its name or `last`; complete or
    not.

    `plot` draws it, `truth` is what only the twin knows.
    """
    return DrawnRun.of(load_run(run_folder(str(folder))))


@dataclass(frozen=True, slots=True, repr=False)
class PrintedTable:
    """Arrow `table` of runs that prints a line for each, and has its columns and
    methods.
    """

    table: pa.Table
    rows: Sequence[RunRow]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.table, name)

    def __getitem__(self, column: str) -> Any:
        return self.table[column]

    def __len__(self) -> int:
        return len(self.rows)

    def __repr__(self) -> str:
        return "\n".join(map(repr, self.rows))


def runs(folder: StrPath = "runs", where: str = "", sort: str = "") -> Any:
    """Table of the runs that `list_runs` lists: a data frame where pandas is installed,
    else an Arrow table in a `PrintedTable`, which prints a line for each run; other
    programs take its `.table`.
    """
    listed = list_runs(folder, where, sort)
    rows = [dict(zip(COLUMNS, values_of(row), strict=True)) for row in listed]
    table = pa.Table.from_pylist(rows)
    frame = as_frame(table)
    return PrintedTable(table, listed) if frame is table else frame


def list_runs(
    folder: StrPath = "runs", where: str = "", sort: str = ""
) -> tuple[RunRow, ...]:
    """List the runs in `folder` for which the SQL expression `where` holds, as `cell
    runs` does.

    Oldest first, or by the column `sort`, downwards with a leading `-`.
    """
    return find_runs(Path(folder), where, sort)


def table(part: Ticks | Profile | Sights) -> pa.Table:
    """Columns of a run as an Arrow table, as `part.table()`."""
    return part.table()


def import_runs(
    places: StrPaths,
    out: StrPath,
    mapping: StrPath | None = None,
    configs: StrPath | None = None,
) -> tuple[Path, ...]:
    """Convert tables, MCAP files or LeRobot data sets to checked run folders; returns
    these.
    """
    from cell.gap.subject.strip.runs import check_fold

    config = find_configs(configs)
    check = partial(check_fold, config.strip_names(), config.strip)
    return import_from(
        _listed(places),
        None if mapping is None else Path(mapping),
        Path(out),
        check,
        length=lambda name: config.strip(name).length,
    )


def export_runs(runs: StrPaths, kind: Format, out: StrPath) -> tuple[Path, ...]:
    """Write `runs` in the format `kind` into the new folder `out`; returns the
    files.
    """
    check_known("kind", kind, get_args(Format))
    return export_to([run_folder(str(run)) for run in _listed(runs)], kind, Path(out))


def observe(
    film: StrPath,
    calibration: Calibration | StrPath,
    strip: str,
    out: StrPath,
    configs: StrPath | None = None,
) -> DrawnRun:
    """Measure the fold on a film, as `cell observe` does; returns the run, written to
    `out`.

    The camera stands still, `calibration` is its own, and the strip lies flat at the
    beginning; no arm is needed. Profile, contact, tip and confidence are those of the
    cell's perception.
    """
    from cell.folding.observe import observe as observe_film

    if not isinstance(calibration, Calibration):
        calibration = read_calibration(calibration)
    observe_film(Path(film), calibration, strip, Path(out), configs)
    return read_run(out)


def fit_gap(
    runs: StrPaths,
    out: StrPath,
    *,
    strip: str | None = None,
    model: StrPath | None = None,
    hold_out: Sequence[str] = (),
    without: Sequence[str] = (),
    jobs: int = 1,
    configs: StrPath | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> "DrawnVerdict":
    """Identify the effects that the model of a strip or mechanism lacks in measured
    `runs`.

    `model` is the file of a mechanism. The verdict is written into the folder `out`
    with report, overlay and patch, as `cell gap fit` does. Effects `without` are
    withheld from the library. `progress` is called with a stage and its share. Raises
    ConfigurationError for bad input.
    """
    from cell.gap.fit import FitOptions, fit
    from cell.gap.fitting import quiet
    from cell.gap.report.overlay import write_overlay

    if (strip is None) == (model is None):
        raise ConfigurationError("give a strip or a model, one of the two")
    file = _subject_file(model or strip or "", configs)
    cell_file = find_configs(configs).cell_path
    options = FitOptions(hold_out, without, jobs=jobs, cell_file=cell_file)
    fit(_listed(runs), file, Path(out), options, progress or quiet, write_overlay)
    return read_verdict(out)


def check(
    runs: StrPaths, subject: StrPath, jobs: int = 1, configs: StrPath | None = None
) -> "CheckReport":
    """Check recordings before a fit: sampling, clocks, duplicates, and what the runs
    can show.

    `subject` is a strip by name, or the file of a strip or mechanism.
    """
    from cell.gap.check import check as check_runs

    return check_runs(_listed(runs), _subject_file(subject, configs), jobs)


def accept(
    out: StrPath,
    subject: StrPath,
    *,
    law: bool = False,
    force: bool = False,
    configs: StrPath | None = None,
) -> "AcceptResult":
    """Write the effects that the fit in `out` named into the `subject` file, or into
    cell.yaml.

    With `law`, the law that describes what nothing explains; with `force`, what is
    suspected.
    """
    from cell.gap.verdict.accept import accept as accept_fit

    return accept_fit(*_fitted(out, subject, configs), law=law, force=force)


def undo(
    out: StrPath, subject: StrPath, configs: StrPath | None = None
) -> "AcceptResult":
    """Restore the files as they were before `accept` of the fit in `out`."""
    from cell.gap.verdict.accept import undo as undo_fit

    return undo_fit(*_fitted(out, subject, configs))


def _fitted(
    out: StrPath, subject: StrPath, configs: StrPath | None
) -> tuple[Path, Path, Path]:
    """Folder of a fit, file of its `subject`, and file of the cell."""
    file = _subject_file(subject, configs)
    return Path(out), file, find_configs(configs).cell_path


def _subject_file(subject: StrPath, configs: StrPath | None) -> Path:
    """Path of the file of `subject`: a strip's name, or a path."""
    return find_configs(configs).strip_path(str(subject))


def read_verdict(out: StrPath) -> "DrawnVerdict":
    """Read the verdict that `fit_gap` wrote into the folder `out`; `plot` draws it."""
    from cell.gap.report.figures import DrawnVerdict
    from cell.gap.verdict.schema import read_verdict as read_verdict_file

    return DrawnVerdict(**dict(read_verdict_file(Path(out) / "verdict.json")))


def read_strip(name: str, configs: StrPath | None = None) -> StripFile:
    """Read and check the strip file called `name`, or the one at that path."""
    return find_configs(configs).strip(name)


def read_calibration(path: StrPath) -> Calibration:
    """Read the calibration file at `path`, or that of the run in the folder `path`.

    `to_image` maps points (n, 2) [m] of the strip's plane to pixels (n, 2), `to_plane`
    back.
    """
    place = Path(path)
    return load_calibration(place / "calibration.yaml" if place.is_dir() else place)


def effects() -> Mapping[str, Effect]:
    """Library of effects by name, with the effects of installed plug-ins."""
    return registry()


def _listed(places: StrPaths) -> list[Path]:
    """List of the paths `places`, given as a single one or several."""
    each = [places] if isinstance(places, str | PathLike) else places
    return list(map(Path, each))
