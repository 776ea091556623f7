"""Runs six cases of the exam for CI: `python -m tests.benchmarks.exam_small`.

Ends with 1 where the workflow names what is not there, or finds less than five of six.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from cell.exam.cases.draw import cases
from cell.exam.report.page import GOOD
from cell.exam.run import run_exam

COUNT, SEED, LEAST, JOBS = 6, 0, 5, 2


def main() -> int:
    """Draw, make, judge, and tell."""
    with TemporaryDirectory() as folder:
        drawn = cases("state", COUNT, SEED, jobs=JOBS)
        entries = run_exam(drawn, Path(folder), jobs=JOBS, progress=_told)
    results = [e.outcome.result if e.outcome else "failed" for e in entries]
    good = sum(result in GOOD for result in results)
    sys.stdout.write(f"{good} of {COUNT} right\n")
    return int(good < LEAST or "false_alarm" in results)


def _told(done: int, total: int, said: str) -> None:
    sys.stdout.write(f"{done}/{total}  {said}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
