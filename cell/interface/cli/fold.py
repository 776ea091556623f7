"""Command `cell fold`: folds a strip and reports the result."""

import math
import sys
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from cell.base.config.length import metres
from cell.base.config.places import Configs, check_recordable, find_configs
from cell.interface.cli import options
from cell.interface.cli.output import busy, notice, print_json, say, working
from drivers.base.errors import CellError, ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from cell.folding.batch import Callbacks
    from cell.folding.feasibility import Feasibility
    from cell.folding.request import Request
    from cell.folding.result import FoldResult
    from cell.folding.series import Remainder
    from cell.orchestrator.run import Observer
    from cell.orchestrator.snapshot import Snapshot

TICKS_SHOWN = 10  # one of so many ticks is shown
LARGEST_OFFSET = 0.1  # m, of edges that a fold can be asked to reach

Film = Literal["libx264", "none"]


@dataclass(frozen=True, slots=True)
class FoldOptions:
    """Options of the command `cell fold`, lengths in m."""

    strip: Annotated[
        str,
        typer.Option(
            help="Strip by name, a path to its .yaml file, or `unknown` with --length.",
            autocompletion=options.strip_names,
        ),
    ]
    policy: Annotated[
        str,
        typer.Option(
            help=f"How the gripper is moved: {', '.join(options.policy_names())}.",
            autocompletion=options.policy_names,
        ),
    ] = "adaptive"
    length: Annotated[
        float | None,
        options.length_option(
            "--length",
            "Length of a strip without a file, as 600mm or 0.6 [m]; the default policy"
            " and the twin's camera allow 0.45 to 0.64 m.",
        ),
    ] = None
    thickness: Annotated[
        float | None,
        options.length_option(
            "--thickness", "Its thickness, where calipers are at hand [m]."
        ),
    ] = None
    checkpoint: Annotated[
        Path | None, typer.Option(help="Weights of a learned policy.")
    ] = None
    plant: Annotated[
        list[str] | None,
        typer.Option(help=f"{options.PLANT_HELP}; repeatable.", metavar="PLANT"),
    ] = None
    arm: options.Arm = None
    camera: options.Camera = None
    repeat: Annotated[int, typer.Option(min=1, help="Folds of each plant.")] = 1
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of fold 0; fold i uses seed + i.")
    ] = 0
    jobs: Annotated[int, typer.Option(min=1, help="Folds side by side.")] = 1
    runs: options.Runs = Path("runs")
    configs: options.Configs = None
    frames: Annotated[
        Literal["all", "key", "none"] | None, typer.Option(help="Which images to keep.")
    ] = None
    film: Annotated[
        Film | None, typer.Option(help="Encoder of the film of all images.")
    ] = None
    viz: options.VizOption = "off"
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="Predict the fold and check its limits; move nothing."
        ),
    ] = False
    rehearse: Annotated[
        bool,
        typer.Option(
            "--rehearse", help="The fold in the air, 20 cm higher, without fabric."
        ),
    ] = False
    no_truth: Annotated[
        bool,
        typer.Option("--no-truth", help="Keep the twin's truth out of the record."),
    ] = False
    full_speed: options.FullSpeed = False
    specimen: Annotated[
        str | None,
        typer.Option(help="Name of this piece of fabric, for what the cell learns."),
    ] = None
    learning: Annotated[
        str | None,
        typer.Option(
            help="Learn from the fold: on, off, auto, or a length to correct by."
        ),
    ] = None
    until: Annotated[
        str | None,
        typer.Option(
            help="Edges as close as this end --repeat; each fold corrects the next."
        ),
    ] = None
    at: Annotated[
        list[str] | None,
        typer.Option(
            help="Fold line, from the grasped edge: a share of the length or a length.",
            metavar="SHARE|LENGTH",
        ),
    ] = None
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on with --repeat where it stopped."),
    ] = False
    as_json: options.Json = False

    def strip_name(self) -> str:
        """Name of the strip; an unmeasured strip is named by its length and
        thickness.
        """
        length = self.length
        if (self.strip == "unknown") != (length is not None):
            raise ConfigurationError(
                "--length: goes with `--strip unknown`, which needs it; other strips"
                " have a file"
            )
        if self.thickness is not None and length is None:
            raise ConfigurationError(
                "--thickness: goes with `--strip unknown`; other strips have a file"
                " that states it"
            )
        if length is None:
            return self.strip
        from cell.base.config.unmeasured_strip import unmeasured_name

        return unmeasured_name(length, self.thickness)

    def close_edges(self) -> float | None:
        """Offset [m] of the edges at which `--until` ends a series of folds; None
        unless given.

        Raises ConfigurationError beside options with which no fold corrects the next
        one.
        """
        if self.until is None:
            return None

        offset = metres("--until", self.until, LARGEST_OFFSET)
        if self.rehearse:
            raise ConfigurationError(
                "--until: folds on the desk; leave it or --rehearse out"
            )
        if self.repeat == 1:
            raise ConfigurationError(
                "--until: ends a series, and one fold has none before it to learn from;"
                " add --repeat with the number of folds at most"
            )
        if self.learning not in {None, "on", "auto"}:
            raise ConfigurationError(
                "--until: corrects each fold by those before; use --learning on"
            )

        return offset

    def request(self, configurations: Configs, strip: str) -> "Request":
        """Request of the first fold, of the strip called `strip`."""
        from cell.base.devices.devices import Trial
        from cell.folding.request import Learning, RecordingOptions, Request, line_at

        settings = configurations.cell().with_drivers(self.arm, self.camera)
        encoder = self.film or settings.record.film
        film = None if encoder == "none" else encoder
        until = None if self.until is None else "on"
        lying = configurations.strip(strip)
        return Request(
            cell=settings,
            strip=lying,
            policy=self.policy,
            runs=self.runs,
            trial=Trial(seed=self.seed),
            checkpoint=self.checkpoint,
            full_speed=self.full_speed,
            record=RecordingOptions(
                self.frames, film, not self.no_truth, live=self.viz == "live"
            ),
            learning=Learning(self.specimen, use=self.learning or until),
            at=line_at("--at", self.at or (), lying.length),
        )


@options.taking(FoldOptions)
def fold(given: FoldOptions) -> None:
    """Fold a strip in half, record the run, and print how well its edges are
    aligned.
    """
    configurations = find_configs(given.configs)
    options.check_names(configurations, given.strip, given.policy)
    name = given.strip_name()
    close_edges = given.close_edges()
    plant_files = [
        configurations.plant_path(name_or_path) for name_or_path in given.plant or []
    ]
    if given.checkpoint is not None:
        options.check_readable(
            given.checkpoint, "; name another checkpoint or train one"
        )
    if not (given.dry_run or given.rehearse):
        check_recordable(given.runs)
    from cell.folding.request import prepare
    from drivers.strip.describe import load_plant

    plants = [load_plant(path) for path in plant_files]
    base = given.request(configurations, name)
    prepared = prepare(base, plants, given.repeat)
    for doubt in prepared.doubts:
        notice(doubt)
    requests = prepared.requests
    if given.dry_run:
        _predict(requests[0], as_json=given.as_json)
    elif given.rehearse:
        sys.exit(_rehearse(requests[0], as_json=given.as_json))
    else:
        sys.exit(_fold_series(requests, given, close_edges))


def _fold_series(
    requests: "Sequence[Request]", given: FoldOptions, until: float | None
) -> int:
    """Carry out one fold, or a series that can be resumed; returns the exit code."""
    if len(requests) == 1:
        if given.resume:
            raise ConfigurationError(
                "--resume: goes with --repeat, or with several --plant"
            )
        return _fold_all(requests, given, until)
    with options.folded_series(requests, "batch", resuming=given.resume) as remainder:
        code = _fold_all(remainder.requests, given, until, remainder)
        if until is not None and code == 0:
            remainder.series.close()
        return code


def _fold_all(
    requests: "Sequence[Request]",
    given: FoldOptions,
    until: float | None,
    remainder: "Remainder | None" = None,
) -> int:
    """Carry out folds and print each result; returns the exit code.

    That is the largest of the folds', or with `until` [m] that of the last one, 1 where
    no edges lie as close. What becomes of those of a `remainder` is kept.
    """
    as_json = given.as_json
    from cell.folding.batch import agreed, fold_all
    from cell.folding.request import with_correction

    requests = agreed(requests, options.ask)
    callbacks = _callbacks(requests[0].cell.emulation, as_json=as_json)
    if remainder is not None:
        callbacks = replace(callbacks, begin=remainder.begin, end=remainder.end)
    exit_code = 0
    try:
        results = fold_all(requests, given.jobs, until, callbacks)
        # an interrupt ends them
        for request, result in zip(requests, results, strict=False):
            if as_json:
                print_json(result.line())
                sys.stdout.flush()
                if result.warning:
                    notice(result.warning)
                if result.exit_code != 0:
                    notice(
                        ": ".join(
                            filter(None, (result.run, result.outcome, result.reason))
                        )
                    )
            elif not result.run:  # a recorded fold was told as soon as it was known
                notice(result.reason)
            exit_code = max(exit_code, result.exit_code)
            if given.viz == "save" and result.run:
                from cell.report.viz.recording import viz_from_run

                viz_from_run(Path(result.run))
            if until is not None and result.ends(until):
                return result.exit_code
            if until is not None:
                following = with_correction(request, "on").learning.correction.seen
                notice(f"the next fold would aim {-1e3 * following:+.1f} mm")
    except CellError as error:
        notice(str(error))
        exit_code = max(exit_code, error.exit_code)
    return exit_code if until is None else max(exit_code, 1)


def _callbacks(robot: str, *, as_json: bool) -> "Callbacks":
    """Callbacks to the operator in a batch of folds; `robot` is a remark on an emulated
    robot.
    """
    from cell.folding.batch import Callbacks
    from cell.setup.arm.run_settings import await_strip

    callbacks = Callbacks(report=notice, lay_again=lambda: await_strip(options.ask))
    if not as_json:
        tell = partial(_print_result, robot=robot)
        return replace(callbacks, observe=progress_of, tell=tell)
    if robot:
        notice(robot)
    return callbacks


def _print_result(result: "FoldResult", robot: str) -> None:
    """Print the result for the operator, with a remark on an emulated `robot`."""
    page = f"page: cell report {quote(result.run)}"
    lines = (str(result), robot, page)
    print("\n  ".join(filter(None, lines)), flush=True)


def _rehearse(request: "Request", *, as_json: bool) -> int:
    """Carry out the fold in the air and print the outcome; returns the exit code."""
    from cell.folding.batch import agreed
    from cell.folding.rehearsal import rehearse
    from cell.orchestrator.operator import Interrupt

    (request,) = agreed([request], options.ask)
    with Interrupt() as interrupted:
        outcome = rehearse(_assessed(request), interrupted)
    facts = {
        "outcome": outcome.name,
        "reason": outcome.reason,
        "exit_code": outcome.exit_code,
    }
    lines = (f"{outcome.name}: {outcome.reason}", request.cell.emulation)
    say(facts, "\n  ".join(filter(None, lines)), as_json=as_json)
    return outcome.exit_code


def _predict(request: "Request", *, as_json: bool) -> None:
    """Predict the fold by simulation and print the prediction."""
    with busy("predicting the fold"):
        prediction = _assessed(request).prediction
    say(prediction.line(), str(prediction), as_json=as_json)


def _assessed(request: "Request") -> "Feasibility":
    """Feasibility of the fold of `request`, seen through the cell's camera."""
    from cell.folding.feasibility import assess
    from cell.setup.calibration_in_use import calibration_of

    return assess(request, calibration_of(request.cell, notice))


class _ProgressLine:
    """Observer that shows a run on one living line: state, share of the way, time
    left.
    """

    def __init__(self, show: "Callable[[str, float], None]", strip: str) -> None:
        self._show = show
        self._strip = strip
        self._count = 0
        self._begin = 0.0  # m, x from which the gripper folds towards 0

    def handle_tick(self, snapshot: "Snapshot") -> None:
        """Show the state, gripper and desk contact of each TICKS_SHOWN-th tick."""
        self._count += 1
        if self._count % TICKS_SHOWN:
            return

        pose = snapshot.arm.pose
        self._begin = max(self._begin, pose.x)
        text = f"{self._strip}  {snapshot.state:<9}"
        text += f" gripper x {1e3 * pose.x:4.0f}  z {1e3 * pose.z:4.0f} mm"
        measurement = snapshot.view.measurement
        if measurement is not None and math.isfinite(measurement.contact_x):
            text += f"  desk contact {1e3 * measurement.contact_x:4.0f} mm"

        done = 0.0 if self._begin <= 0 else 1.0 - pose.x / self._begin
        self._show(text, min(max(done, 0.0), 1.0))

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """Print a fault on a line of its own, which stays visible; ignore other
        events.
        """
        if kind == "fault" and sys.stderr.isatty():
            print(f"{time:.2f} s  {facts['name']}: {facts['reason']}", file=sys.stderr)


@contextmanager
def progress_of(strip: str) -> "Iterator[tuple[Observer, ...]]":
    """Observers that show the progress of a fold of `strip`."""
    with working("opening the cell") as show:
        yield (_ProgressLine(show, strip),)
