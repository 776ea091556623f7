"""What a campaign costs beside its cases, and how long one would take on many workers, on paper.

    python -m tests.lab bench-campaign overhead [--parts 40] [--jobs 2]
    python -m tests.lab bench-campaign records [--count 3000]
    python -m tests.lab bench-campaign plan JOURNAL --cases 3000 --workers 40
    python -m tests.lab bench-campaign kills STUDY... [--count 12] [--times 30] [--seed 0]

`overhead` measures parts that sleep for a second: what a part costs besides, on the wall clock and
of the process that hands them out. `records` reads journal files. `plan` draws costs of cases from
a journal, hands them to the free worker next in turn as a study does, and says how long that
takes, and up to how many workers the process that hands out keeps up. `kills` ends a study with its
processes at random moments, and compares its table with that of an undisturbed one.
"""

import argparse
import heapq
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from cell.campaign.journal import Journal, Record
from cell.campaign.local import Local
from cell.campaign.run import carry_out
from drivers.types import Array
from tests.support.campaign_parts import Fine, Noted

HANDED_OUT = (
    0.012  # s of the process that hands out a part, by `overhead` on this project's machine
)
START = 6.0  # s until a worker takes its first case, compiled code in its cache
SLEEP = 1.0  # s


def overhead(parts: int, jobs: int) -> str:
    """Seconds beside the cases, a part."""
    wanted = [Fine(f"part {n}", seconds=SLEEP) for n in range(parts)]
    with tempfile.TemporaryDirectory() as place:
        list(carry_out(wanted[:jobs], Path(place) / "warm", Local(jobs), Noted()))
        processor, begun, first = time.process_time(), time.perf_counter(), None
        for count, _ in enumerate(carry_out(wanted, Path(place) / "j", Local(jobs), Noted()), 1):
            first = first or (time.perf_counter(), count)
        wall = time.perf_counter() - first[0] if first else 0.0
        started = first[0] - begun - SLEEP if first else 0.0
        handed = (time.process_time() - processor) / parts
    more = wall * jobs / (parts - jobs) - SLEEP
    return (
        f"a part of {SLEEP:g} s takes {1e3 * more:.0f} ms more, {10 * more:.2f} % of one of 10 s; "
        f"{1e3 * handed:.1f} ms of processor hand it out; the first began after {started:.1f} s"
    )


def records(count: int) -> str:
    """Seconds to read a journal."""
    outcome = {"values": {"true": 0.1, "rows": [0.1] * 20}}
    one = Record(schema=1, key="x", of="first", state="measured", outcome=outcome)
    with tempfile.TemporaryDirectory() as place:
        journal = Journal(Path(place))
        for number in range(count):
            record = one.model_copy(update={"key": f"{number:05d}"})
            path = journal.path(record.key, record.of)
            path.write_text(record.model_dump_json(by_alias=True))
        begun = time.perf_counter()
        found = len(journal.records())
        return f"{found} records read in {time.perf_counter() - begun:.2f} s"


def plan(costs: Array, workers: int, handed_out: float) -> tuple[float, float]:
    """Hours until the last of cases of `costs` [s] is done by `workers`, and the share of their
    time in which they measure; a case is handed out in `handed_out` [s], one after another.
    """
    free, next_out = [START] * workers, 0.0
    for cost in costs:
        begins = max(heapq.heappop(free), next_out)
        next_out = begins + handed_out
        heapq.heappush(free, begins + float(cost))
    last = max(free)
    return last / 3600.0, float(costs.sum()) / (workers * last)


def planned(journal: Path, cases: int, workers: int) -> str:
    """The plan of `cases` like those of `journal`."""
    walls = np.array([r.cost.processor for r in Journal(journal).records() if r.done])
    if not len(walls):
        sys.exit(f"{journal}: holds no record of a measured case")
    costs = np.random.default_rng(0).choice(walls, cases)
    hours, busy = plan(costs, workers, HANDED_OUT)
    most = next(
        (n for n in (2**k for k in range(3, 16)) if plan(costs, n, HANDED_OUT)[1] < 0.9), None
    )
    many = f"{cases} cases of {walls.mean():.1f} s of processor ({len(walls)} measured)"
    return (
        f"{many}: {costs.sum() / 3600:.1f} hours of one core, {hours:.2f} hours on {workers} "
        f"workers, {100 * busy:.0f} % of them busy; under 90 % from {most} workers on"
    )


def kills(study: str, count: int, times: int, rng: np.random.Generator) -> str:
    """Whether a study that is killed so many times ends with the table of one that is not."""
    with tempfile.TemporaryDirectory() as place:
        whole, torn = Path(place) / "whole", Path(place) / "torn"
        begun = time.perf_counter()
        _study(study, count, whole).wait()
        took = time.perf_counter() - begun
        for _ in range(times):
            process = _study(study, count, torn)
            with suppress(subprocess.TimeoutExpired):
                process.wait(rng.uniform(0.0, took))
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            half = len(Journal(torn / "journal").records())
        _study(study, count, torn).wait()
        same = (whole / "table.md").read_bytes() == (torn / "table.md").read_bytes()
        return f"{study}: killed {times} times, {half} of {count} cases then; " + (
            "the same table" if same else "ANOTHER table"
        )


def _study(name: str, count: int, out: Path) -> subprocess.Popen[bytes]:
    words = ["study", name, "--count", str(count), "--out", str(out)]
    return subprocess.Popen(
        [sys.executable, "-m", "tests.lab", *words], start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def main() -> None:
    """Measure or plan as asked."""
    reader = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    which = reader.add_subparsers(dest="what", required=True)
    asked = which.add_parser("overhead")
    asked.add_argument("--parts", type=int, default=40)
    asked.add_argument("--jobs", type=int, default=2)
    which.add_parser("records").add_argument("--count", type=int, default=3000)
    asked = which.add_parser("plan")
    asked.add_argument("journal", type=Path)
    asked.add_argument("--cases", type=int, default=3000)
    asked.add_argument("--workers", type=int, default=40)
    asked = which.add_parser("kills")
    asked.add_argument("studies", nargs="+")
    asked.add_argument("--count", type=int, default=12)
    asked.add_argument("--times", type=int, default=30)
    asked.add_argument("--seed", type=int, default=0)
    given = reader.parse_args()
    if given.what == "kills":
        rng = np.random.default_rng(given.seed)
        for name in given.studies:
            print(kills(name, given.count, given.times, rng), flush=True)
        return
    if given.what == "overhead":
        text = overhead(given.parts, given.jobs)
    elif given.what == "records":
        text = records(given.count)
    else:
        text = planned(given.journal, given.cases, given.workers)
    sys.stdout.write(text + "\n")
