"""Commands that are killed, meet another of their kind, or fill the disk: what is lost or claimed?

    python -m tests.lab interrupted kills [--count 100] [--seed 0] [COMMAND ...]
    python -m tests.lab interrupted pairs [COMMAND ...]
    python -m tests.lab interrupted full [--count 20] [COMMAND ...]

Every command runs in a folder of its own, with a copy of the configuration and a fold that was made
before. `kills` ends its whole process group at a random moment of the time that it takes; `pairs`
starts two at once; `full` (root, for a tmpfs) leaves from none to all of the room that it takes.
Afterwards no file that was there may be lost or half written, nothing may read as finished that is
not whole, and the same command must then succeed. Exit code 1 where one of this fails.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from calibration.calibration import load_calibration
from cell.campaign.journal import Journal
from cell.config.cell import CellFile
from cell.config.places import find_configs
from cell.gap.verdict.schema import read_verdict
from cell.record.files import RESULT, RUN
from cell.record.run import read_run
from drivers.errors import CellError
from drivers.readers import read_yaml
from drivers.settings import load
from drivers.strip.describe import load_strip
from policies.checkpoint import load_checkpoint
from tests.support.gap_strip_cases import folds, written

CELL, LAB = ((sys.executable, "-m", package) for package in ("cell", "tests.lab"))
LONGEST = 1800.0  # s of one command
USAGE, STOPPED = 2, 4  # the exit codes with which a command may refuse or stop in one line
MARGIN = 64 << 10  # bytes that even an empty disk has


@dataclass(frozen=True, slots=True)
class Command:
    """A command of the cell: its words in a folder, and what must have been made there before."""

    words: Callable[[Path], list[str]]
    prepare: Callable[[Path], None] = lambda _: None


def measured(root: Path) -> None:
    """Three short folds of denim, as a laboratory would hand them in."""
    written(root / "measured", folds(("normal", "fast", "normal")))


def accepted(root: Path) -> None:
    """A fit whose patches wait to be accepted."""
    from tests.cell.gap.test_gap_accept_survives import CELL as PATCH
    from tests.cell.gap.test_gap_accept_survives import Fitted

    (root / "fit").mkdir()
    made = Fitted(root / "fit")
    (made.out / "cell-patch.yaml").write_text(yaml.safe_dump(PATCH))
    shutil.copy(made.file, root / "configs" / "strips" / "denim.yaml")


def _cell(root: Path) -> list[str]:
    return ["--configs", str(root / "configs")]


COMMANDS = {
    "fold": Command(lambda r: ["fold", "--strip", "denim", "--runs", str(r / "runs"), *_cell(r)]),
    "calibrate": Command(lambda r: ["calibrate", *_cell(r)]),
    "fit": Command(
        lambda r: ["gap", "fit", str(r / "measured"), "--strip", "denim", "--out", str(r / "out"),
                   "--jobs", "1", *_cell(r)], measured),
    "accept": Command(
        lambda r: ["gap", "accept", str(r / "fit" / "out"), "--strip", "denim", *_cell(r)],
        accepted),
    "train": Command(
        lambda r: ["train", "--out", str(r / "trained"), "--generations", "2", "--population", "4",
                   "--strips", "1", "--grid", "2", "--jobs", "1"]),
    "study": Command(
        lambda r: ["study", "latencies", "--count", "2", "--out", str(r / "studied")]),
    "new": Command(
        lambda r: ["strips", "new", "felt", "--length", "0.6", "--width", "0.05", *_cell(r)]),
    "report": Command(lambda r: ["report", str(r / "before")]),
}  # fmt: skip


def begun(root: Path, name: str, fold: Path) -> dict[Path, bytes]:
    """A folder to run command `name` in; the files that it holds from before."""
    shutil.copytree(find_configs(None).folder, root / "configs")
    shutil.copytree(fold, root / "before")
    COMMANDS[name].prepare(root)
    keep = [p for p in root.rglob("*") if p.is_file()]
    return {path: path.read_bytes() for path in keep}


def started(name: str, root: Path) -> subprocess.Popen[str]:
    """The command, leader of a process group of its own."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "TMPDIR": str(root)}
    return subprocess.Popen(
        [*(LAB if name == "study" else CELL), *COMMANDS[name].words(root)],
        env=environment, start_new_session=True, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code of the command, and all that it wrote."""
    said, _ = process.communicate(timeout=LONGEST)
    return process.returncode, said.strip()


def faults(root: Path, before: dict[Path, bytes]) -> Iterator[str]:
    """What is lost of the files from `before`, half written, or claimed."""
    for path, content in before.items():
        if not path.exists():
            yield f"lost: {path.relative_to(root)}"
        elif path.suffix in (".parquet", ".jpg") and path.read_bytes() != content:
            yield f"changed: {path.relative_to(root)}"
    readers: list[tuple[str, Callable[[Path], object]]] = [
        ("configs/strips/*.yaml", load_strip),
        ("configs/cell.yaml", lambda path: load(path, CellFile)),
        ("configs/calibration*.yaml", load_calibration),
        ("**/verdict.json", read_verdict),
        ("trained/**/*.npz", load_checkpoint),
        ("runs/*/" + RUN, lambda path: read_run(path.parent)),
        ("runs/*/" + RESULT, read_yaml),
    ]
    for pattern, read in readers:
        for path in root.glob(pattern):
            try:
                read(path)
            except CellError as error:
                yield f"not whole: {path.relative_to(root)}: {str(error).splitlines()[0]}"
    for folder in {path.parent for path in (root / "studied").rglob("*.json")}:
        if len(Journal(folder).records()) < len(list(folder.glob("[!.]*.json"))):
            yield f"not whole: a record in {folder.relative_to(root)}"


def again(name: str, root: Path) -> Iterator[str]:
    """What keeps the same command from succeeding now."""
    code, said = ended(started(name, root))
    if code and not (name == "new" and code == USAGE and "is there already" in said):
        yield f"afterwards it ends with {code}: {said}"


def kill(name: str, moment: float, root: Path, fold: Path) -> list[str]:
    """Faults after the command was killed at `moment` [s]."""
    before = begun(root, name, fold)
    process = started(name, root)
    try:
        process.wait(moment)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    return [*faults(root, before), *_unless_accepted(name, root)]


def _unless_accepted(name: str, root: Path) -> Iterator[str]:
    """An acceptance that was whole is refused the second time, and undone by its own command."""
    if name != "accept" or not (root / "fit" / "out" / "accepted.json").exists():
        yield from again(name, root)
        return
    words = ["gap", "undo", str(root / "fit" / "out"), "--strip", "denim", *_cell(root)]
    undone = subprocess.run([*CELL, *words], capture_output=True, text=True, check=False)
    if undone.returncode:
        yield from again(name, root)


def pair(name: str, root: Path, fold: Path) -> list[str]:
    """Faults after two of the command at once: each succeeds or refuses in one line."""
    before = begun(root, name, fold)
    found = []
    for process in [started(name, root) for _ in range(2)]:
        code, said = ended(process)
        if code not in (0, USAGE, STOPPED) or "Traceback" in said:
            found.append(f"one of two ended with {code}: {said}")
    return [*found, *faults(root, before)]


@contextmanager
def disk(root: Path, size: int) -> Iterator[None]:
    """A file system of `size` bytes at `root`."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", root], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", root], check=True)


def used(root: Path) -> int:
    """Bytes that the files under `root` take, in whole pages."""
    return sum(-(-p.stat().st_size // 4096) * 4096 + 4096 for p in root.rglob("*"))


def full(name: str, share: float, taken: int, root: Path, fold: Path) -> list[str]:
    """Faults where a disk has a `share` of the `taken` bytes that the command needs."""
    with tempfile.TemporaryDirectory() as aside:
        begun(Path(aside) / "there", name, fold)
        room = used(Path(aside)) + MARGIN + int(share * taken)
    with disk(root, room):
        before = begun(root / "there", name, fold)
        code, said = ended(started(name, root / "there"))
        found = list(faults(root / "there", before))
        if code and ("Traceback" in said or not said):
            found.append(f"it ended with {code}: {said}")
    return found


def whole(name: str, fold: Path) -> tuple[float, int]:
    """Seconds and bytes that the command takes by itself."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "there"
        begun(root, name, fold)
        had, clock = used(root), time.perf_counter()
        code, said = ended(started(name, root))
        if code:
            raise SystemExit(f"{name} by itself ends with {code}: {said}")
        return time.perf_counter() - clock, max(used(root) - had, 4096)


def tried(
    mode: str, names: Sequence[str], count: int, seed: int
) -> Iterator[tuple[str, list[str]]]:
    """Each trial in words, and its faults."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        shutil.copytree(find_configs(None).folder, root / "configs")
        subprocess.run(
            [*CELL, *COMMANDS["fold"].words(root)], check=True, stdout=subprocess.DEVNULL
        )
        fold = next((root / "runs").iterdir())
        cost = {name: whole(name, fold) for name in names} if mode != "pairs" else {}
        for number in range(count if mode != "pairs" else len(names)):
            name, place = names[number % len(names)], root / str(number)
            place.mkdir()
            if mode == "kills":
                moment = float(rng.uniform(0.0, cost[name][0]))
                yield f"{name} at {moment:.2f} s", kill(name, moment, place / "there", fold)
            elif mode == "pairs":
                yield f"two of {name}", pair(name, place / "there", fold)
            else:
                share = (number // len(names) + 0.5) * len(names) / count
                found = full(name, share, cost[name][1], place, fold)
                yield f"{name} with {share:.0%} of the room", found
            shutil.rmtree(place, ignore_errors=True)


def main() -> int:
    """The trials that are asked for; the exit code."""
    reader = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    reader.add_argument("mode", choices=("kills", "pairs", "full"))
    reader.add_argument("names", nargs="*", metavar="COMMAND", help=f"of {', '.join(COMMANDS)}")
    reader.add_argument("--count", type=int, help="trials [default: 100 kills, 20 full disks]")
    reader.add_argument("--seed", type=int, default=0)
    asked = reader.parse_intermixed_args()
    unknown = [name for name in asked.names if name not in COMMANDS]
    if unknown:
        reader.error(f"{unknown[0]}: allowed: {', '.join(COMMANDS)}")
    names = asked.names or (
        list(COMMANDS) if asked.mode != "full" else ["fold", "calibrate", "fit", "train", "study"]
    )
    count = asked.count or {"kills": 100, "full": 20}.get(asked.mode, 0)
    bad = done = 0
    for words, found in tried(asked.mode, names, count, asked.seed):
        done, bad = done + 1, bad + bool(found)
        print(f"{'FAULT ' if found else 'well  '} {words}", *found, sep="\n    ", flush=True)
    print(f"{done - bad} of {done} lost nothing and claimed nothing")
    return int(bad > 0)
