"""Diagnoses a case in a separate process that gets its run folders and strip file only.

The key stays with the parent, which draws the cases from its seed. `python -m
tests.lab.exam.diagnosis`, in a folder with strip.yaml and runs/, is that process.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import TYPE_CHECKING

from cell.record.files import PROFILE, RESULT, RUN, TICKS
from drivers.base.child import THREADS
from drivers.base.errors import CellError

if TYPE_CHECKING:
    from cell.gap.verdict.findings import Findings
    from cell.gap.verdict.schema import Verdict

FILES = (RUN, TICKS, PROFILE, RESULT)
VERDICT_FILE, NOTES, OUTPUT = "verdict.json", "exam.json", "output"
# s; it ends what hangs: how long a fit may take has a bar of its own
TIME_LIMIT = 1800.0
ENVIRONMENT = (
    "PATH",
    "HOME",
    "XDG_CACHE_HOME",
    "NUMBA_CACHE_DIR",
    "LANG",
    "SYSTEMROOT",
)
ROOT = Path(__file__).resolve().parents[3]


class NoVerdict(CellError):
    """Error of a diagnosis without verdict: it ran too long, died or refused its
    input.
    """


@dataclass(frozen=True, slots=True)
class Effort:
    """Wall time [s] and peak memory [MB] of a diagnosis."""

    wall: float
    memory: float


def diagnose(
    strip: Path,
    runs: Sequence[Path],
    out: Path,
    *,
    limit: float = TIME_LIMIT,
    workdirs: Path | None = None,
) -> Effort:
    """Diagnose the `runs` of `strip`; writes verdict.json and exam.json to `out`.

    The runs are laid out in a new folder within `workdirs` (usually that of temporary
    files). Raises NoVerdict after `limit` [s], and with the last line of output where
    the process failed.
    """
    with TemporaryDirectory(prefix="exam-", dir=workdirs) as name:
        workdir = Path(name).resolve()
        stage(workdir, strip, runs)
        begin = monotonic()
        _run(workdir, limit)
        wall = monotonic() - begin
        out.mkdir(parents=True, exist_ok=True)
        for file in (VERDICT_FILE, NOTES):
            shutil.copyfile(workdir / "out" / file, out / file)
    notes = json.loads((out / NOTES).read_text(encoding="utf-8"))
    return Effort(wall, notes["memory"])


def stage(workdir: Path, strip: Path, runs: Sequence[Path]) -> None:
    """Copy the permitted files into `workdir`: the strip file and four files of each
    run.
    """
    shutil.copyfile(strip, workdir / "strip.yaml")
    for run in runs:
        folder = workdir / "runs" / run.name
        folder.mkdir(parents=True)
        for file in FILES:
            if (run / file).is_file():
                shutil.copyfile(run / file, folder / file)


def _run(workdir: Path, limit: float) -> None:
    """Run the process in `workdir`; its environment reveals nothing of the case."""
    environment = {key: os.environ[key] for key in ENVIRONMENT if key in os.environ}
    environment |= {
        "PYTHONPATH": str(ROOT),
        "TMPDIR": str(workdir),
        **dict.fromkeys(THREADS, "1"),
    }
    with (workdir / OUTPUT).open("wb") as output:
        try:
            ended = subprocess.run(
                [sys.executable, "-P", "-m", "tests.lab.exam.diagnosis"],
                cwd=workdir,
                env=environment,
                timeout=limit,
                check=False,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
            )
        except subprocess.TimeoutExpired:
            raise NoVerdict(
                f"no verdict after {limit:.0f} s; the process was ended"
            ) from None
    if ended.returncode:
        text = (workdir / OUTPUT).read_text(encoding="utf-8", errors="replace")
        last = (text.strip().splitlines() or ["no output"])[-1]
        raise NoVerdict(f"the workflow ended with code {ended.returncode}: {last}")


def main() -> None:
    """Diagnose the runs of this folder; a CellError is one line of output and an exit
    code.
    """
    from cell.gap.fit import fit

    notes: dict[str, object] = {}

    def note(found: "Findings", _verdict: "Verdict", _path: Path) -> None:
        notes["scatter"] = {s.name: s.value for s in found.model_tests.scatter}

    try:
        fit([Path("runs")], Path("strip.yaml"), Path("out"), overlay=note)
    except CellError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(error.exit_code)
    notes["memory"] = peak_memory()
    (Path("out") / NOTES).write_text(json.dumps(notes), encoding="utf-8")


def peak_memory() -> float:
    """Largest resident memory of this process [MB]."""
    import resource

    # `getrusage` counts what the parent held before as well
    status = Path("/proc/self/status")
    text = status.read_text(encoding="utf-8") if status.is_file() else ""
    peak = re.search(r"^VmHWM:\s+(\d+) kB", text, re.MULTILINE)
    return (
        int(peak[1] if peak else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
        / 1024
    )


if __name__ == "__main__":
    main()
