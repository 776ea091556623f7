"""`cell fold`."""

import json
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.cli.options import Configs, Json, Runs, policy_names
from drivers.errors import CellError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from cell.operations.fold import Request
    from cell.operations.result import FoldResult


class ArmDriver(StrEnum):
    """Arm drivers."""

    TWIN = "twin"
    FCI = "fci"


class CameraDriver(StrEnum):
    """Camera drivers."""

    TWIN = "twin"
    V4L2 = "v4l2"


class Frames(StrEnum):
    """Which images a run keeps."""

    ALL = "all"
    KEY = "key"
    NONE = "none"


class Viz(StrEnum):
    """What happens with the Rerun recording."""

    SAVE = "save"
    LIVE = "live"
    OFF = "off"


StripName = Annotated[
    str, typer.Option(help="Strip by name, a path to its .yaml file, or `unknown` with --length.")
]
PolicyName = Annotated[str, typer.Option(help=f"How the gripper is moved: {policy_names()}.")]
Length = Annotated[float | None, typer.Option(help="Length [m] of a strip that has no file.")]
Thickness = Annotated[
    float | None, typer.Option(help="Its thickness [m], where calipers are at hand.")
]
Plants = Annotated[
    list[Path] | None, typer.Option(help="Strip file that lies on the twin's desk; repeatable.")
]


def fold(
    strip: StripName,
    policy: PolicyName = "adaptive",
    length: Length = None,
    thickness: Thickness = None,
    checkpoint: Annotated[Path | None, typer.Option(help="Weights of a learned policy.")] = None,
    plant: Plants = None,
    arm: Annotated[ArmDriver | None, typer.Option(help="Arm driver.")] = None,
    camera: Annotated[CameraDriver | None, typer.Option(help="Camera driver.")] = None,
    repeat: Annotated[int, typer.Option(min=1, help="Folds of each plant.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Seed of fold 0; fold i uses seed + i.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Folds side by side.")] = 1,
    runs: Runs = Path("runs"),
    configs: Configs = None,
    frames: Annotated[Frames | None, typer.Option(help="Which images to keep.")] = None,
    viz: Annotated[Viz, typer.Option(help="Rerun: save a recording, show it live too, off.")] = (
        Viz.SAVE
    ),
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Predict the fold and check its limits; move nothing.")
    ] = False,
    no_truth: Annotated[
        bool, typer.Option("--no-truth", help="Keep the twin's truth out of the record.")
    ] = False,
    full_speed: Annotated[
        bool, typer.Option("--full-speed", help="A real robot not slowed to a tenth.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Fold a strip in half and say how well it went."""
    from cell.devices.devices import DeviceSelection
    from cell.operations.batch import checked, doubts_about, requests
    from cell.operations.fold import Request

    choice = DeviceSelection(arm and arm.value, camera and camera.value, None, seed)
    base = Request(
        strip=_named(strip, length, thickness),
        policy=policy,
        checkpoint=checkpoint,
        choice=choice,
        runs=runs,
        configs=configs,
        frames=frames.value if frames else None,
        truth=not no_truth,
        viz=viz.value,
        full_speed=full_speed,
    )
    wanted = checked(requests(base, plant or [], repeat))
    for doubt in doubts_about(wanted):
        _remark(doubt)
    if dry_run:
        _predict(base, as_json=as_json)
        return
    sys.exit(_folded(base, wanted, jobs, as_json=as_json))


def _folded(base: "Request", wanted: "Sequence[Request]", jobs: int, *, as_json: bool) -> int:
    """Fold and tell; the largest exit code."""
    real = _real(base)
    code = 0
    try:
        for result in _results(wanted, 1 if real else jobs, quiet=as_json, real=real):
            _tell(result, as_json=as_json)
            code = max(code, result.exit_code)
    except CellError as error:
        sys.stderr.write(f"cell: {error}\n")
        code = max(code, error.exit_code)
    return code


def _named(strip: str, length: float | None, thickness: float | None) -> str:
    """The strip as requests name it: one without a file by its length, and thickness if known."""
    from cell.config.unknown import NAME, name_of
    from drivers.errors import ConfigurationError

    if (strip == NAME) != (length is not None):
        raise ConfigurationError(
            "--length: goes with `--strip unknown`, which needs it; other strips have a file"
        )
    if thickness is not None and length is None:
        raise ConfigurationError(
            "--thickness: goes with `--strip unknown`; other strips have a file that states it"
        )
    return strip if length is None else name_of(length, thickness)


def _real(base: "Request") -> bool:
    """Whether a real robot will move; then the operator has typed the cell's name."""
    from cell.config.places import find_configs
    from cell.operations.real_robot import confirm, is_real

    settings = find_configs(base.configs).cell()
    if not is_real(settings, base.choice):
        return False
    confirm(settings, _ask)
    return True


def _ask(question: str) -> str:
    sys.stderr.write(question)
    sys.stderr.flush()
    return sys.stdin.readline()


def _results(
    wanted: "Sequence[Request]", jobs: int, *, quiet: bool, real: bool
) -> "Iterator[FoldResult]":
    from cell.config.places import find_configs
    from cell.operations.batch import each_of
    from cell.operations.calibrate import calibration_of
    from cell.operations.fold import fold as fold_once
    from cell.operations.interrupt import Interrupt
    from cell.operations.progress import progress

    settings = find_configs(wanted[0].configs).cell()
    if jobs > 1 and len(wanted) > 1:
        with Interrupt() as interrupted:
            calibration = calibration_of(settings, _remark, interrupted)
            for request, made in zip(
                wanted, each_of(wanted, jobs, interrupted, calibration), strict=False
            ):
                yield _as_result(request, made)
        return
    for number, request in enumerate(wanted):
        if real and number > 0:
            _ask("Lay the strip again, flat and straight, then press Enter: ")
        with Interrupt() as interrupted, progress(quiet=quiet) as shown:
            calibration = calibration_of(settings, _remark, interrupted)
            try:
                made = fold_once(request, shown, interrupted, calibration)
            except CellError as error:
                made = error
        yield _as_result(request, made)
        if interrupted():
            return


def _as_result(request: "Request", made: "FoldResult | CellError") -> "FoldResult":
    """One fold's own trouble ends that fold alone; Ctrl-C, given twice, ends the batch."""
    from cell.operations.interrupt import Interrupted
    from cell.operations.result import FoldResult

    if isinstance(made, Interrupted):
        raise made
    if isinstance(made, CellError):
        name = Path(request.strip).stem
        return FoldResult.refused(name, request.policy, request.choice.seed, made)
    return made


def _tell(result: "FoldResult", *, as_json: bool) -> None:
    if as_json:
        sys.stdout.write(json.dumps(result.line(), allow_nan=False) + "\n")
        if result.exit_code != 0:
            _remark(": ".join(filter(None, (result.run, result.outcome, result.reason))))
    elif result.run:
        sys.stdout.write(f"{result.sentence()}\n  record: {result.run}\n")
    else:
        _remark(result.reason)
    sys.stdout.flush()


def _remark(text: str) -> None:
    sys.stderr.write(f"cell: {text}\n")


def _predict(request: "Request", *, as_json: bool) -> None:
    from cell.operations.prediction import predict

    prediction = predict(request)
    text = json.dumps(prediction.line(), allow_nan=False) if as_json else prediction.text()
    sys.stdout.write(text + "\n")
