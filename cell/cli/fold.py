"""The command `cell fold`: folds a strip and reports the result."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from cell.cli.options import (
    Arm,
    Camera,
    Configs,
    FullSpeed,
    Json,
    Runs,
    VizOption,
    ask,
    busy,
    check_names,
    length_option,
    policy_names,
    print_json,
    strip_names,
)
from drivers.errors import CellError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from cell.folding.fold import Request
    from cell.folding.result import FoldResult
    from cell.record.film import Encoder


LARGEST_OFFSET = 0.1  # m, of edges that a fold can be asked to reach


Film = Literal["libx264", "none"]
FilmOption = Annotated[Film | None, typer.Option(help="Encoder of the film of all images.")]
Frames = Annotated[Literal["all", "key", "none"] | None, typer.Option(help="Which images to keep.")]
StripName = Annotated[
    str,
    typer.Option(
        help="Strip by name, a path to its .yaml file, or `unknown` with --length.",
        autocompletion=strip_names,
    ),
]
PolicyName = Annotated[
    str,
    typer.Option(
        help=f"How the gripper is moved: {', '.join(policy_names())}.", autocompletion=policy_names
    ),
]
Length = Annotated[
    float | None,
    length_option("--length", "Length of a strip that has no file, as 600mm or 0.6 [m]."),
]
Thickness = Annotated[
    float | None, length_option("--thickness", "Its thickness, where calipers are at hand [m].")
]
Plants = Annotated[
    list[Path] | None, typer.Option(help="Strip file that lies on the twin's desk; repeatable.")
]


Specimen = Annotated[
    str | None, typer.Option(help="Name of this piece of fabric, for what the cell learns.")
]
Learning = Annotated[
    str | None, typer.Option(help="Learn from the fold: on, off, auto, or a length to correct by.")
]
Until = Annotated[
    str | None,
    typer.Option(help="Edges as close as this end --repeat; each fold corrects the next."),
]
NoTruth = Annotated[
    bool, typer.Option("--no-truth", help="Keep the twin's truth out of the record.")
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Predict the fold and check its limits; move nothing.")
]
Rehearse = Annotated[
    bool, typer.Option("--rehearse", help="The fold in the air, 20 cm higher, without fabric.")
]


def fold(
    strip: StripName,
    policy: PolicyName = "adaptive",
    length: Length = None,
    thickness: Thickness = None,
    checkpoint: Annotated[Path | None, typer.Option(help="Weights of a learned policy.")] = None,
    plant: Plants = None,
    arm: Arm = None,
    camera: Camera = None,
    repeat: Annotated[int, typer.Option(min=1, help="Folds of each plant.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Seed of fold 0; fold i uses seed + i.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Folds side by side.")] = 1,
    runs: Runs = Path("runs"),
    configs: Configs = None,
    frames: Frames = None,
    film: FilmOption = None,
    viz: VizOption = "save",
    dry_run: DryRun = False,
    rehearse: Rehearse = False,
    no_truth: NoTruth = False,
    full_speed: FullSpeed = False,
    specimen: Specimen = None,
    learning: Learning = None,
    until: Until = None,
    as_json: Json = False,
) -> None:
    """Fold a strip in half and say how well it went."""
    check_names(configs, strip, policy)
    from cell.devices.devices import DeviceSelection
    from cell.folding.batch import check_requests, doubts_about, requests
    from cell.folding.correct import with_correction
    from cell.folding.fold import Request

    choice = DeviceSelection(arm, camera, None, seed)
    base = Request(
        strip=_name_strip(strip, length, thickness),
        policy=policy,
        checkpoint=checkpoint,
        choice=choice,
        runs=runs,
        configs=configs,
        frames=frames,
        truth=not no_truth,
        viz=viz,
        film=encoder_of(configs, film),
        full_speed=full_speed,
        specimen=specimen,
    )
    base = with_correction(base, "on" if until is not None and learning is None else learning)
    wanted = check_requests(requests(base, plant or [], repeat))
    for doubt in doubts_about(wanted):
        _print_remark(doubt)
    if dry_run:
        _predict(base, as_json=as_json)
        return
    if until is not None:
        sys.exit(_fold_until(wanted, until, as_json=as_json))
    if rehearse:
        sys.exit(_rehearse(base, as_json=as_json))
    sys.exit(_fold_each(wanted, jobs, as_json=as_json))


def encoder_of(configs: Path | None, film: Film | None) -> "Encoder | None":
    """Encoder of films, that of the configuration where none is asked for; None for no film."""
    from cell.config.places import find_configs

    wanted = film or find_configs(configs).cell().record.film
    return None if wanted == "none" else wanted


def _fold_until(wanted: "Sequence[Request]", until: str, *, as_json: bool) -> int:
    """Fold until the edges lie as close as `until`; returns the exit code, 1 where none does.

    Each fold is corrected by those before it.
    """
    from cell.config.length import metres
    from cell.folding.correct import with_correction

    close = metres("--until", until, LARGEST_OFFSET)
    code = 1
    for request in wanted:
        made: list[FoldResult] = []
        code = _fold_each([with_correction(request, "on")], 1, made.append, as_json=as_json)
        if code > 1 or (code == 0 and _laid_offset(made) <= close):
            return code
        following = with_correction(request, "on").correction.total
        _print_remark(f"the next fold would aim {-1e3 * following:+.1f} mm")
    return 1


def _laid_offset(made: "list[FoldResult]") -> float:
    """Offset [m] of the newest fold's laid edges, of its layers where no edge was seen."""
    seen = [made[-1].edge_offset, made[-1].displacement] if made else []
    return next((abs(value) for value in seen if value is not None), float("inf"))


def _fold_each(
    wanted: "Sequence[Request]",
    jobs: int,
    keep: "Callable[[FoldResult], None]" = lambda _: None,
    *,
    as_json: bool,
) -> int:
    """Fold, report and `keep` each result; returns the largest exit code."""
    wanted = agree_to_fold(wanted)
    real, remark = wanted[0].choice.agreed, _emulation(wanted[0])
    code = 0
    if remark and as_json:
        _print_remark(remark)
    try:
        for result in _results(wanted, 1 if real else jobs, quiet=as_json, real=real):
            _print_result(result, remark, as_json=as_json)
            keep(result)
            code = max(code, result.exit_code)
    except CellError as error:
        sys.stderr.write(f"cell: {error}\n")
        code = max(code, error.exit_code)
    return code


def _name_strip(strip: str, length: float | None, thickness: float | None) -> str:
    """Name of the strip for requests; one without a file is named by length and thickness."""
    from cell.config.unknown import UNKNOWN_NAME, name_of
    from drivers.errors import ConfigurationError

    if (strip == UNKNOWN_NAME) != (length is not None):
        raise ConfigurationError(
            "--length: goes with `--strip unknown`, which needs it; other strips have a file"
        )
    if thickness is not None and length is None:
        raise ConfigurationError(
            "--thickness: goes with `--strip unknown`; other strips have a file that states it"
        )
    return strip if length is None else name_of(length, thickness)


def agree_to_fold(wanted: "Sequence[Request]") -> "tuple[Request, ...]":
    """Have the operator of a real robot agree to its motion; returns the requests with consent.

    Raises PreflightRefused where that was not typed, or a check of real hardware failed.
    """
    from cell.arm.real_robot import confirm
    from cell.config.places import find_configs
    from cell.devices.open import is_real, real_camera
    from cell.doctor.doctor import BRIEF, checks, refuse_red

    base = wanted[0]
    configs = find_configs(base.configs)
    settings = configs.cell()
    real = is_real(settings, base.choice)
    if real or real_camera(settings, base.choice):
        refuse_red([*checks(configs, base.choice, base.runs, BRIEF)])
    if not real:
        return tuple(wanted)
    confirm(settings, ask)
    return tuple(replace(r, choice=replace(r.choice, agreed=True)) for r in wanted)


def _results(
    wanted: "Sequence[Request]", jobs: int, *, quiet: bool, real: bool
) -> "Iterator[FoldResult]":
    """Results of the folds as they end, made side by side or one after the other."""
    if jobs > 1 and len(wanted) > 1:
        return _results_side_by_side(wanted, jobs)
    return _results_in_turn(wanted, quiet=quiet, real=real)


def _results_side_by_side(wanted: "Sequence[Request]", jobs: int) -> "Iterator[FoldResult]":
    from cell.calibrating.calibrate import calibration_of
    from cell.folding.batch import each_of
    from cell.orchestrator.interrupt import Interrupt

    settings, _ = wanted[0].read_files()
    with Interrupt() as interrupted:
        calibration = calibration_of(settings, _print_remark, interrupted)
        folds = each_of(wanted, jobs, interrupted, calibration)
        for request, made in zip(wanted, folds, strict=False):  # an interrupt ends the folds
            yield _as_result(request, made)


def _results_in_turn(
    wanted: "Sequence[Request]", *, quiet: bool, real: bool
) -> "Iterator[FoldResult]":
    from cell.arm.real_robot import await_strip
    from cell.calibrating.calibrate import calibration_of
    from cell.folding.fold import fold as fold_once
    from cell.folding.progress import progress
    from cell.orchestrator.interrupt import Interrupt

    settings, _ = wanted[0].read_files()
    for number, request in enumerate(wanted):
        if real and number > 0:
            await_strip(ask)
        with Interrupt() as interrupted, progress(quiet=quiet) as shown:
            calibration = calibration_of(settings, _print_remark, interrupted)
            made: FoldResult | CellError
            try:
                made = fold_once(request, shown, interrupted, calibration)
            except CellError as error:
                made = error
        yield _as_result(request, made)
        if interrupted():
            return


def _as_result(request: "Request", made: "FoldResult | CellError") -> "FoldResult":
    """Convert a fold's own error to a result, so that a batch goes on; Ctrl-C twice ends it."""
    from cell.folding.result import FoldResult
    from cell.orchestrator.interrupt import Interrupted

    if isinstance(made, Interrupted):
        raise made
    if isinstance(made, CellError):
        name = Path(request.strip).stem
        return FoldResult.refusal(name, request.policy, request.choice.seed, made)
    return made


def _emulation(request: "Request") -> str:
    from cell.devices.open import emulation

    return emulation(request.read_files()[0], request.choice)


def _print_result(result: "FoldResult", remark: str, *, as_json: bool) -> None:
    if as_json:
        print_json(result.line())
        if result.exit_code != 0:
            _print_remark(": ".join(filter(None, (result.run, result.outcome, result.reason))))
    elif result.run:
        lines = (result.sentence(), remark, f"record: {result.run}")
        sys.stdout.write("\n  ".join(filter(None, lines)) + "\n")
    else:
        _print_remark(result.reason)
    sys.stdout.flush()


def _print_remark(text: str) -> None:
    sys.stderr.write(f"cell: {text}\n")


def _rehearse(request: "Request", *, as_json: bool) -> int:
    """Rehearse the fold once and report it; returns the exit code."""
    from cell.folding.rehearsal import rehearse
    from cell.orchestrator.interrupt import Interrupt

    (request,) = agree_to_fold([request])
    with Interrupt() as interrupted:
        outcome = rehearse(request, interrupted)
    line = {"outcome": outcome.name, "reason": outcome.reason, "exit_code": outcome.exit_code}
    words = filter(None, (f"{outcome.name}: {outcome.reason}", _emulation(request)))
    text = json.dumps(line) if as_json else "\n  ".join(words)
    sys.stdout.write(text + "\n")
    return outcome.exit_code


def _predict(request: "Request", *, as_json: bool) -> None:
    from cell.folding.prediction import predict

    with busy("predicting the fold"):
        prediction = predict(request)
    text = json.dumps(prediction.line(), allow_nan=False) if as_json else prediction.text()
    sys.stdout.write(text + "\n")
