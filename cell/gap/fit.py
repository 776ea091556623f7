"""`cell gap fit`: measured runs and a file in, a verdict, a report and perhaps a patch out."""

import hashlib
import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from threadpoolctl import threadpool_limits

from cell.gap.fitting.cache import SimulationCache
from cell.gap.investigate import Progress, investigate
from cell.gap.report.page import write_report
from cell.gap.selection import hold_out as hold
from cell.gap.subject.run_folders import RunFolder, find_runs
from cell.gap.subject.subject import Subject
from cell.gap.verdict.accept import CELL_PATCH, LAW_PATCH, PATCH, RECORD, dumped, sha256
from cell.gap.verdict.compose import verdict as compose
from cell.gap.verdict.findings import Findings
from cell.gap.verdict.schema import Verdict, write_text
from drivers.errors import ConfigurationError
from drivers.settings import read_yaml

Overlay = Callable[[Findings, Path], None]
"""Writes a recording of measured and simulated runs; handed in by who has a viewer."""

READ = ("run.yaml", "result.yaml", "ticks.parquet", "profile.parquet", "angles.parquet")
VERSION = "28"  # of the engine: another one starts anew


def quiet(stage: str, share: float) -> None:
    """Progress that nobody watches."""


def fit(
    runs: Sequence[Path],
    file: Path,
    out: Path,
    hold_out: Sequence[str] = (),
    progress: Progress = quiet,
    jobs: int = 1,
    overlay: Overlay | None = None,
    without: Sequence[str] = (),
) -> Verdict:
    """The verdict on measured `runs` of the strip or pendulum in `file`, written into `out`.

    Effects `without` are withheld from the library. Interrupted, it goes on where it stopped when
    called again with the same inputs. Raises ConfigurationError, and leaves no verdict, for bad
    input.
    """
    began = time.monotonic()
    _clear(out)
    found_runs = find_runs(runs)
    hold.check([run.name for run in found_runs], hold_out)
    subject = open_subject(file, found_runs, jobs, without)
    key = _key(file, found_runs, [*hold_out, *without])
    _make(out)
    tape = SimulationCache(subject.simulate, out / ".rounds" / key)
    with threadpool_limits(1, "blas"):  # matrices are small: threads only wait for each other
        held = hold.held_out(subject, tape, hold_out)
        found = investigate(subject, held, tape, progress)
    verdict = compose(found, time.monotonic() - began, tape.total)
    verdict = verdict.model_copy(update={"notes": list(subject.notes)})
    progress("write", 0.97)
    _write(found, verdict, file, out)
    if overlay is not None:
        overlay(found, out / "overlay.rrd")
    write_text(out / "verdict.json", verdict.to_json())
    tape.erase()
    progress("done", 1.0)
    return verdict


def open_subject(
    file: Path, runs: Sequence[RunFolder], jobs: int, without: Sequence[str] = ()
) -> Subject:
    """The subject that `file` describes, with its measured runs; effects `without` are withheld.

    Raises ConfigurationError for a file of another kind, or an effect that cannot be withheld.
    """
    kind = read_yaml(file).get("kind", "strip")
    if kind == "pendulum":
        from cell.gap.subject.pendulum.subject import open_pendulum

        if without:
            raise ConfigurationError("--without: withholds effects of a strip, not of a pendulum")
        return open_pendulum(file, runs, jobs)
    if kind == "strip":
        from cell.gap.subject.strip.subject import open_strip

        return open_strip(file, runs, jobs, without)
    raise ConfigurationError(f"{file}: kind: is {kind!r}; allowed: strip, pendulum")


def _write(found: Findings, verdict: Verdict, file: Path, out: Path) -> None:
    """Write everything but the verdict itself, which comes last."""
    record = {"schema": 1, "file": str(file), "file_sha256": sha256(file),
              "effects": [e.name for e in verdict.effects],
              "scatter": [asdict(s) for s in found.judged.scatter],
              "steadier": {s.name: s.sigma for s in found.advised.steadier},
              "law": found.offered and asdict(found.offered)}  # fmt: skip
    write_text(out / RECORD, json.dumps(record, indent=1))
    write_report(found, verdict, out / "report.html")
    source = f"cell gap fit, {out.name}"
    if found.offered is not None:
        terms = {name: {"amount": value} for name, value in found.offered.terms.items()}
        law_patch, _ = found.subject.patch(found.offered.base, terms, source)
        write_text(out / LAW_PATCH, dumped(law_patch))
    if verdict.verdict != "named":
        return
    base = {name: v.value for name, v in verdict.base.items()}
    effects = {e.name: {k: v.value for k, v in e.parameters.items()} for e in verdict.effects}
    patch, cell_patch = found.subject.patch(base, effects, source)
    write_text(out / PATCH, dumped(patch))
    if cell_patch is not None:
        write_text(out / CELL_PATCH, dumped(cell_patch))


def _key(file: Path, runs: Sequence[RunFolder], held: Sequence[str]) -> str:
    """Hash of everything that the simulations depend on."""
    h = hashlib.sha256(VERSION.encode())
    h.update(file.read_bytes())
    for run in runs:
        for path in (run.path / name for name in READ):
            h.update(path.name.encode() + (path.read_bytes() if path.is_file() else b"absent"))
    h.update("\0".join(held).encode())
    return h.hexdigest()[:16]


def _clear(out: Path) -> None:
    """No verdict of an earlier fit stays; ConfigurationError where none could be written."""
    first = next(p for p in (out.absolute(), *out.absolute().parents) if p.exists())
    if not first.is_dir() or not os.access(first, os.W_OK | os.X_OK):
        what = "cannot be written to" if first.is_dir() else "is a file"
        raise ConfigurationError(f"--out {out}: {first} {what}; give a folder that can be written")
    for name in ("verdict.json", PATCH, CELL_PATCH, LAW_PATCH, "accepted.json"):
        (out / name).unlink(missing_ok=True)


def _make(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"--out {out}: cannot be made: {error.strerror}; give a folder that can be written"
        ) from None
