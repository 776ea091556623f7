"""Sandboxed process: restricts its own file access, then diagnoses the runs in its folder.

Started as `python -m tests.lab.exam.sandbox.child PERMIT` in a folder with strip.yaml and runs/;
PERMIT is a `Policy` as JSON. Only the standard library is imported before the bar is down.
"""

import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tests.lab.exam.sandbox.restrict import Policy, die_with_parent, restrict

if TYPE_CHECKING:
    from cell.gap.verdict.findings import Findings
    from cell.gap.verdict.schema import Verdict

VERDICT_FILE, NOTES = "verdict.json", "exam.json"


def main() -> None:
    """Diagnose the runs; a CellError is printed as one line and sets the exit code."""
    die_with_parent()
    given = json.loads(sys.argv[1])
    _import_packages()
    kernel = restrict(Policy(**{key: tuple(map(Path, paths)) for key, paths in given.items()}))
    from drivers.errors import CellError

    try:
        _judge(kernel)
    except CellError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(error.exit_code)


def _import_packages() -> None:
    """Import the bare packages, so that modules inside are found by their own paths."""
    import calibration as _calibration  # noqa: F401
    import drivers as _drivers  # noqa: F401
    import policies as _policies  # noqa: F401


def _judge(kernel: bool) -> None:
    from cell.gap.fit import fit

    out = Path("out")
    notes: dict[str, object] = {"kernel": kernel}

    def note(found: "Findings", _verdict: "Verdict", _path: Path) -> None:
        notes["tried"] = refitted_models(found)
        notes["scatter"] = {s.name: s.value for s in found.judged.scatter}

    fit([Path("runs")], Path("strip.yaml"), out, jobs=1, overlay=note)
    notes["memory"] = peak_memory()
    (out / NOTES).write_text(json.dumps(notes), encoding="utf-8")


def refitted_models(found: "Findings") -> list[dict[str, object]]:
    """Facts on every refitted model: name, number of effects, in-sample mean square and loss."""
    from cell.gap.selection.likelihood import mean_square

    return [
        {
            "name": m.model.name,
            "effects": len(m.model.effects),
            "mean_square": mean_square(m.estimate.residuals),
            "objective": m.estimate.objective,
        }
        for m in found.choice.fits.models
    ]


def peak_memory() -> float | None:
    """Largest resident memory of this process [MB]; None where the kernel does not report it."""
    try:
        status = Path("/proc/self/status").read_text(encoding="utf-8")
    except OSError:
        return None
    peak = re.search(r"^VmHWM:\s+(\d+) kB", status, re.MULTILINE)
    return int(peak[1]) / 1024 if peak else None
