"""The command `cell gap plan`: folds the standard runs for a comparison with the model."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cell.cli.options import (
    Configs,
    Json,
    Strip,
    ask,
    check_names,
    check_readable,
    print_json,
    while_busy,
)
from drivers.errors import CellError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cell.folding.request import Request
    from cell.folding.result import FoldResult


def plan(
    strip: Strip,
    plant: Annotated[
        Path | None, typer.Option(help="Strip file that lies on the twin's desk.")
    ] = None,
    runs: Annotated[
        Path | None, typer.Option("--runs", help="New folder of these runs [runs/NAME-plan].")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of run 0; run i uses seed + i.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Runs side by side.")] = 1,
    configs: Configs = None,
    no_truth: Annotated[
        bool, typer.Option("--no-truth", help="Keep the twin's truth out of the records.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say which runs would be made; move nothing.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Fold the standard runs: speeds, heights, a hold, there and back, shakes, repeats."""
    check_names(configs, strip)
    from cell.config.places import check_recordable, find_configs
    from cell.record.files import check_empty

    folder = runs or Path("runs") / f"{Path(strip).stem}-plan"
    check_empty(folder)
    if not dry_run:
        check_recordable(folder)
    if plant is not None:
        check_readable(plant)
    from cell.devices.devices import DeviceSelection
    from cell.folding.request import Recording, Request
    from cell.folding.standard_runs import standard_requests
    from drivers.strip.describe import load_plant

    found, desk = find_configs(configs), None if plant is None else load_plant(plant)
    choice, record = DeviceSelection(plant=desk, seed=seed), Recording(truth=not no_truth)
    base = Request(found.cell(), found.strip(strip), "", folder, choice, record=record)
    requests = standard_requests(base)
    if dry_run:
        _print_plan(requests)
        return
    code = _fold_all(requests, jobs, as_json=as_json)
    if not as_json:
        sys.stdout.write(f"next: {_next_command(strip, folder, configs)}\n")
    sys.exit(code)


def _fold_all(requests: "Sequence[Request]", jobs: int, *, as_json: bool) -> int:
    """Make the runs and report each; returns the largest exit code of those that went wrong."""
    from cell.arm.run_settings import await_strip
    from cell.folding.batch import Attendance, agreed, fold_all
    from cell.folding.standard_runs import went_as_planned

    requests, code = agreed(requests, ask), 0
    attendance = Attendance(lay_again=lambda: await_strip(ask))
    results = while_busy("folding", fold_all(requests, jobs, attendance=attendance))
    for i, (request, result) in enumerate(zip(requests, results, strict=False)):
        if isinstance(result, CellError):
            raise result
        _print_result(i, len(requests), request, result, as_json=as_json)
        code = max(code, 0 if went_as_planned(result) else result.exit_code)
    return code


def _next_command(strip: str, folder: Path, configs: Path | None) -> str:
    """Command that the user types next to fit the runs in `folder`."""
    file = strip_file(strip, configs)
    return f"cell gap fit {folder} --strip {file} --out {folder.with_name(folder.name + '-fit')}"


def strip_file(named: str, configs: Path | None) -> Path:
    """Path of the file of the strip `named` by a path, or by its name in the configuration."""
    from cell.config.places import find_configs

    if Path(named).exists() or "/" in named or Path(named).suffix:
        return Path(named)
    return near(find_configs(configs).strip_path(named))


def near(file: Path) -> Path:
    """Path of `file` relative to the working directory, where it lies below."""
    return file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file


def _print_plan(wanted: "tuple[Request, ...]") -> None:
    from policies.experiments.standard import STANDARD
    from policies.registry import MOTION

    for i, request in enumerate(wanted):
        name = request.policy.removeprefix(MOTION)
        reveals = STANDARD[name].reveals
        sys.stdout.write(f"{i:2d}  {name:15s} {request.speed:.2f} m/s  shows {reveals}\n")


def _print_result(
    i: int, of: int, request: "Request", result: "FoldResult", *, as_json: bool
) -> None:
    if as_json:
        print_json(result.line())
    else:
        from policies.experiments.standard import STANDARD
        from policies.registry import MOTION

        name = request.policy.removeprefix(MOTION)
        d = result.displacement
        gave = f"{result.outcome}" + ("" if d is None else f", displacement {1e3 * d:.1f} mm")
        sys.stdout.write(
            f"{i + 1}/{of}  {name:15s} {gave:32s} shows {STANDARD[name].reveals}  {result.run}\n"
        )
    sys.stdout.flush()
