"""Mutation testing: defects put into a copy of the tree, one by one, that tests must
find.

    python -m tests.lab mutants [PART OF A NAME ...]

They stand in `mutants.yaml`. What was judged before is not run again unless the
mutant, its file or its tests have changed. Prints the score of each file and the
survivors; the exit code is 1 with fewer than LEAST percent killed, 2 for a mutant
that does not apply or tests that fail without one.
"""

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import pytest
import typer
import yaml

from cell.record.documents import json_line
from drivers.base.files import append_line
from drivers.base.readers import read_json_lines

ROOT = Path(__file__).parents[2]
LIST = Path(__file__).with_suffix(".yaml")
WORK = Path(tempfile.gettempdir()) / "folding-cell-mutants"
LEAST = 95.0  # percent that must be killed
LONGEST = 600  # s for the tests of one mutant; longer is a hang, which somebody notices
LIBRARIES = (
    *(
        "numpy",
        "cv2",
        "yaml",
        "pydantic",
        "ruckig",
        "scipy.optimize",
        "scipy.spatial.transform",
    ),
    *("numba", "pyarrow", "pylibfranka"),
)
# read anew, from the copy
OWN = {"tests", "cell", "drivers", "calibration", "policies"}
BROKEN = 99  # exit code of a process in which pytest itself failed
HUNG = "killed by time"


class Unusable(Exception):
    """A mutant or its tests cannot be used as the list states them."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """Defect: `new` text for `old`, once in `file`, and its `tests`."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    def apply_to(self, text: str) -> str:
        """Text of the file with the defect; Unusable where it does not apply."""
        if text.count(self.old) != 1:
            raise Unusable(
                f"{self.name}: its text occurs {text.count(self.old)} times in"
                f" {self.file}"
            )
        return text.replace(self.old, self.new)

    def key(self, root: Path) -> str:
        """Digest of all that the outcome depends on: the defect, its file, its
        tests.
        """
        names = [self.file, *(test.partition("::")[0] for test in self.tests)]
        texts = [(root / name).read_text("utf-8") for name in names]
        parts = [self.old, self.new, *self.tests, *texts]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def listed() -> tuple[Mutant, ...]:
    """Mutants of the list, in its order."""
    entries = yaml.safe_load(LIST.read_text("utf-8"))
    return tuple(
        Mutant(**{**entry, "tests": tuple(entry["tests"])}) for entry in entries
    )


def copied(work: Path) -> Path:
    """A copy of the working tree under `work`, in which unchanged files keep their
    times.
    """
    names = subprocess.check_output(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, text=True
    ).splitlines()
    tree = work / "tree"
    for name in names:
        source, target = ROOT / name, tree / name
        if source.is_file() and (not target.exists() or changed(source, target)):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    gone = {p for p in tree.rglob("*.py") if not (ROOT / p.relative_to(tree)).exists()}
    for path in gone:
        path.unlink()
    return tree


def changed(source: Path, target: Path) -> bool:
    return source.read_bytes() != target.read_bytes()


def tested(tree: Path, tests: Iterable[str]) -> str:
    """Outcome of `tests` in the `tree`, in a process of their own; killed where they
    fail.
    """
    process = get_context("fork").Process(target=_run, args=(tree, tuple(tests)))
    process.start()
    process.join(LONGEST)
    if process.is_alive():
        os.killpg(process.pid, signal.SIGKILL)
        process.join()
        return HUNG
    return (
        "survived"
        if process.exitcode in {0, pytest.ExitCode.NO_TESTS_COLLECTED}
        else "killed"
    )


def _run(tree: Path, tests: tuple[str, ...]) -> None:
    """Run `tests` as a fresh pytest would in `tree`, but with the libraries loaded."""
    os.setsid()
    os.chdir(tree)
    os.environ |= {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
    for name in [name for name in sys.modules if name.partition(".")[0] in OWN]:
        del sys.modules[name]
    sys.path[:] = [
        str(tree),
        *(path for path in sys.path if path not in ("", str(ROOT))),
    ]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    code = BROKEN
    try:
        code = int(
            pytest.main(
                ["-x", "-q", "-m", "not long", "-p", "no:cacheprovider", *tests]
            )
        )
    finally:
        os._exit(code)


def preload() -> None:
    """Load the libraries that tests spend most of their time loading; never the cell's
    own code.
    """
    for name in LIBRARIES:
        if find_spec(name) is not None:
            import_module(name)


def judged(mutant: Mutant, tree: Path) -> str:
    """Outcome of the tests with the defect applied; the file is restored afterwards."""
    path = tree / mutant.file
    text, times = path.read_text("utf-8"), path.stat()
    path.write_text(mutant.apply_to(text), "utf-8")
    try:
        return tested(tree, mutant.tests)
    finally:
        path.write_text(text, "utf-8")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


def judge_all(mutants: tuple[Mutant, ...], work: Path) -> dict[str, str]:
    """Outcome of each mutant by its name; Unusable where tests fail without any bug.

    A line of the journal in `work` keeps each, so that an interrupted run goes on where
    it was.
    """
    work.mkdir(parents=True, exist_ok=True)
    preload()
    tree, journal = copied(work), work / "journal.jsonl"
    for mutant in mutants:
        mutant.apply_to((tree / mutant.file).read_text("utf-8"))
    known = {line["key"]: line["outcome"] for line in read_json_lines(journal)}
    outcomes: dict[str, str] = {}

    def keep(key: str, name: str, outcome: str) -> None:
        known[key] = outcome
        append_line(journal, json_line({"key": key, "name": name, "outcome": outcome}))

    new = [m for m in mutants if m.key(tree) not in known]
    sources = sorted({(tree / mutant.file).read_text("utf-8") for mutant in mutants})
    for test in sorted({test for mutant in new for test in mutant.tests}):
        content = (tree / test.partition("::")[0]).read_text("utf-8")
        key = hashlib.sha256("\0".join([test, content, *sources]).encode()).hexdigest()
        if key not in known:
            keep(key, test, tested(tree, [test]))
        if known[key] != "survived":
            raise Unusable(
                f"{test} is {known[key]} without any bug; mend it, or remove its line"
            )
    for mutant in mutants:
        key, begun = mutant.key(tree), time.perf_counter()
        if key not in known:
            keep(key, mutant.name, judged(mutant, tree))
        outcomes[mutant.name] = known[key]
        took = time.perf_counter() - begun
        print(f"{known[key]:15s} {took:6.1f} s  {mutant.name}", flush=True)
    return outcomes


def main(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Only mutants whose name contains one of these."),
    ] = None,
) -> int:
    """Judge the chosen mutants and print the survivors; returns the exit code."""
    mutants = tuple(m for m in listed() if not names or any(n in m.name for n in names))
    try:
        outcomes = judge_all(mutants, WORK)
    except Unusable as error:
        print(error, file=sys.stderr)
        return 2
    survivors = [name for name, outcome in outcomes.items() if outcome == "survived"]
    for file in sorted({mutant.file for mutant in mutants}):
        here = [outcomes[mutant.name] for mutant in mutants if mutant.file == file]
        print(
            f"{len(here) - here.count('survived'):4d} of {len(here):3d} killed  {file}"
        )
    killed = 100 * (1 - len(survivors) / max(len(outcomes), 1))
    print(f"{len(outcomes) - len(survivors)} of {len(outcomes)} killed, {killed:.1f} %")
    for name in survivors:
        print(f"survived: {name}")
    return int(killed < LEAST)
