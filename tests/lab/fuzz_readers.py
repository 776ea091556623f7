"""Feeds malformed documents and run folders to all readers of files.

`python -m tests.lab fuzz-readers [--documents N] [--folders N] [--seed S]`: any error
that is not one of the cell's own, more than 2 s of processor time for one input, or
more than 1 GB of memory ends it with exit code 1 and the input that did it.
"""

import faulthandler
import gc
import json
import resource
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from hypothesis import HealthCheck, Phase, given, seed, settings, strategies as st

from calibration.calibration import load_calibration, save_calibration
from cell.base.config.cell import CellFile
from cell.base.config.places import find_configs
from cell.folding.replay import replay
from cell.gap.subject.mechanism.mechanism_file import MechanismFile
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.runs import read_runs
from cell.gap.verdict.accept import accept, undo
from cell.gap.verdict.schema import read_verdict
from cell.record.header import Header, Result
from cell.record.listing import list_runs
from cell.record.run import read_broken_run, read_run
from cell.record.truth import read_truth, write_truth
from cell.report.page import write_report
from cell.report.viz.recording import viz_from_run
from drivers.base.errors import CellError
from drivers.base.settings import load
from drivers.strip.describe import load_plant, load_strip
from policies.feedback import load_checkpoint
from tests.cell.conftest import HEADER, RESULT, made_run, straight_camera
from tests.support.fit_folders import verdict_of, write_fit
from tests.support.hostile_files import Spoiled, copied, documents, spoilers

LONGEST = 2.0  # s of processor time for one input
PATIENCE = 120.0  # s in which a reader must be done, whatever else the machine does
PAGE = 0.8  # s for a whole folder's page where LONGEST holds; a slower machine has more
MEMORY = 1000  # MB at most
DRAWN = 4  # one folder in so many is drawn as a page and a recording
Reader = Callable[[Path], object]


class TooLong(Exception):
    """Error of a reader that exceeds the allowed processor time for one input."""


def tried(read: Callable[[], object], longest: float = LONGEST) -> str:
    """How a reader took its input: `read` or `refused`; anything else is raised.

    Raises TooLong for more than `longest` [s] of processor time, also in a second try:
    a slow input is slow again, a slowed machine is not. Who waits longer than PATIENCE
    ends this process, and leaves its input in the folder of temporary files. What other
    inputs have left is not collected meanwhile: that may take longer.
    """
    for _ in range(2):
        gc.disable()
        faulthandler.dump_traceback_later(PATIENCE, exit=True)
        begun = time.process_time()
        try:
            how = _tried(read)
        finally:
            faulthandler.cancel_dump_traceback_later()
            gc.enable()
        if time.process_time() - begun < longest:
            return how
    raise TooLong(f"over {longest:.1f} s")


def _tried(read: Callable[[], object]) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            read()
        except CellError as error:
            if "defect of the program" in str(error):
                raise
            return "refused"
    return "read"


def document_readers() -> dict[str, tuple[dict[str, Any], Reader]]:
    """By name: a valid document, and the function that reads such files."""
    configs = find_configs(None)
    strip = yaml.safe_load(configs.strip_path("denim").read_text())
    strip["effects"] = {
        "bending_hysteresis": {"yield_curvature": 20.0, "stiffness_ratio": 8.0}
    }
    strip["spread"] = {"bending_length": [0.015, 0.019]}
    arm = yaml.safe_load((configs.folder / "mechanisms/arm/mechanism.yaml").read_text())
    cell = yaml.safe_load((configs.folder / "cell.yaml").read_text())
    weights = {"schema": 1, "policy": "feedback", "weights": [0.1] * 101}
    return {
        "strip": (strip, load_strip),
        "plant": (strip, load_plant),
        "cell": (cell, lambda path: load(path, CellFile)),
        "calibration": (_camera_file(), load_calibration),
        "mechanism": (arm, lambda path: load(path, MechanismFile)),
        "run": ({"schema": 1, **HEADER}, lambda path: load(path, Header)),
        "result": ({"schema": 1, **RESULT}, lambda path: load(path, Result, bare=True)),
        "checkpoint": (
            {**weights, "training": {"seed": 0, "generations": 1, "folds": 1}},
            load_checkpoint,
        ),
        "verdict": (_verdict_file(), read_verdict),
    }


def _camera_file() -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "calibration.yaml"
        save_calibration(straight_camera(), path)
        content: dict[str, Any] = yaml.safe_load(path.read_text())
    return content


def _verdict_file() -> dict[str, Any]:
    """Content of a verdict with something in each of its lists."""
    advice = {"experiment": "e", "separates": ["a", "b"]}
    whole = verdict_of(
        ambiguous=[["a", "b"]],
        unexplained={"description": "d", "law": "l", "stable": True},
        base={"bending_length": {"value": 0.02, "low": 0.01, "high": None}},
        advice=[{**advice, "expected_sigma": 1.0, "minutes": 1.0}],
        detectable={"seam": 1.0},
        held_out=["r"],
    )
    return json.loads(whole.to_json())


def fuzz_documents(count: int, start: int, folder: Path) -> Counter[str]:
    """Counts of documents read or refused by each reader, `count` malformed ones in
    all.
    """
    took: Counter[str] = Counter()
    readers = document_readers()
    for name, (whole, read) in readers.items():
        as_json = name in ("checkpoint", "verdict")
        path = folder / f"{name}.{'json' if as_json else 'yaml'}"

        def check(
            content: bytes, path: Path = path, read: Reader = read, name: str = name
        ) -> None:
            path.write_bytes(content)
            took[f"{name} {tried(lambda: read(path))}"] += 1

        _drawn(documents(whole), check, count // len(readers), start)
    return took


def read_everything(folder: Path, longest: float, *, pages: bool) -> Counter[str]:
    """Counts of readers that read or refuse a run folder; `pages` adds report and
    recording.
    """
    strip = load_strip(find_configs(None).strip_path("denim"))
    readers: dict[str, Reader] = {
        "list": lambda f: list_runs(f.parent),
        "run": read_run,
        "salvage": read_broken_run,
        "truth": read_truth,
        "replay": replay,
        "fit": lambda f: read_runs(find_runs([f.parent]), strip),
    }
    if pages:
        readers |= {"report": write_report, "viz": viz_from_run}
    return Counter(
        f"{name} {tried(lambda: r(folder), longest)}"  # noqa: B023
        for name, r in readers.items()
    )


def longest_here(whole: Path) -> float:
    """Allowed processor time [s] for a run folder, scaled by that of a valid one's
    page.
    """
    begun = time.process_time()
    write_report(whole)
    return LONGEST * max(1.0, (time.process_time() - begun) / PAGE)


def fuzz_folders(count: int, start: int, root: Path) -> Counter[str]:
    """Counts of reads and refusals of `count` malformed run folders; some are also
    drawn.
    """
    took: Counter[str] = Counter()
    whole = made_run(root / "whole", straight_camera(), 0.9)
    write_truth(whole, {"displacement": -0.0351, "plant": {}})
    first = copied(whole, root / "first" / whole.name)
    for read in (write_report, viz_from_run):
        read(first)  # what they import and compile once counts for no input
    usual = longest_here(first)
    for seed_of in (8, 9):  # folds of other seeds, beside which a spoiled one is fitted
        beside = copied(whole, root / "runs" / f"a-whole-{seed_of}")
        text = (beside / "run.yaml").read_text()
        (beside / "run.yaml").write_text(text.replace("seed: 7", f"seed: {seed_of}"))

    def check(changes: tuple[Spoiled, ...]) -> None:
        folder = copied(
            whole, root / "runs" / "20261121T000000Z-denim-fold-0000", *changes
        )
        drawn = took["folders"] % DRAWN == 0
        try:
            took.update(read_everything(folder, usual, pages=drawn))
        except TooLong:
            again = longest_here(first)  # the machine may have slowed since
            try:
                took.update(read_everything(folder, again, pages=drawn))
            except TooLong:
                place = f"folder {took['folders']}: over {again:.1f} s"
                raise SystemExit(f"{place}: {changes}") from None
        took["folders"] += 1
        if took["folders"] % 1000 == 0:
            print(f"{took['folders']} of {count} folders", flush=True)

    spoiled = spoilers(whole)
    _drawn(st.tuples(spoiled) | st.tuples(spoiled, spoiled), check, count, start)
    return took


def fuzz_acceptance(count: int, start: int, root: Path) -> Counter[str]:
    """Counts of reads and refusals by accept and undo of `count` malformed fit
    folders.
    """
    took: Counter[str] = Counter()
    root.mkdir(parents=True, exist_ok=True)
    source = find_configs(None).strip_path("denim")
    strip = yaml.safe_load(source.read_text())
    cell, file, out = root / "cell.yaml", root / "s.yaml", root / "out"
    file.write_bytes(source.read_bytes())
    undo_record = {
        "schema": 1,
        "acceptances": [
            {
                "fit": str(out.resolve()),
                "effects": ["seam"],
                "before": {"s.yaml": "x"},
                "after": {},
            }
        ],
    }
    contents = {
        "subject": json.dumps(strip),
        "cell": json.dumps({"effects": {"desk_tilt": {"angle": 0.01}}}),
    }
    write_fit(out, file, "accept", contents)
    parts = {
        out / "fit.json": json.loads((out / "fit.json").read_text()),
        file.with_name("s.yaml.undo.json"): undo_record,
        out / "patch.yaml": strip,
        out / "cell-patch.yaml": json.loads(contents["cell"]),
    }
    for path, part in parts.items():

        def check(content: bytes, path: Path = path) -> None:
            file.write_bytes(source.read_bytes())
            cell.write_bytes((find_configs(None).folder / "cell.yaml").read_bytes())
            shutil.rmtree(out, ignore_errors=True)
            file.with_name("s.yaml.undo.json").unlink(missing_ok=True)
            patches = {"patch.yaml": "subject", "cell-patch.yaml": "cell"}
            role = patches.get(path.name)
            changed = {role: content} if role else {}
            write_fit(out, file, "accept", contents | changed)
            if not role:
                path.write_bytes(content)
            took[f"undo {tried(lambda: undo(out, file, cell))}"] += 1
            took[f"accept {tried(lambda: accept(out, file, cell))}"] += 1

        _drawn(documents(part), check, count // len(parts), start)
    return took


def _drawn(strategy: Any, check: Callable[[Any], None], count: int, start: int) -> None:
    @seed(start)
    @settings(
        max_examples=max(count, 1),
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def run(drawn: Any) -> None:
        check(drawn)

    run()


def main(documents: int = 10_000, folders: int = 1_000, seed: int = 0) -> int:
    """Fuzz documents, fits and folders; prints the counts, returns 1 for too much
    memory.
    """
    with tempfile.TemporaryDirectory() as name:
        root, began = Path(name), time.process_time()
        took = fuzz_documents(documents, seed, root)
        took += fuzz_acceptance(documents // 20, seed, root / "fit")
        took += fuzz_folders(folders, seed, root)
    for what, times in sorted(took.items()):
        sys.stdout.write(f"{what:24s} {times:6d}\n")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    sys.stdout.write(
        f"{time.process_time() - began:.0f} s of processor time, {peak:.0f} MB\n"
    )
    return 0 if peak < MEMORY else 1
