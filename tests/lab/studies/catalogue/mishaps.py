"""Study of mishaps: persons who calibrate clumsily, wrong strips, kills, and bombs in
files.

Each case is told, or does no harm; it ends within its watch, and leaves what it found
whole or able to go on. None of them is a fault of a device: those are `faults`.
"""

import os
import shlex
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from calibration.board import BoardSettings
from calibration.wizard.lens_verdict import lens_verdict
from calibration.wizard.touch_verdict import touch_verdict
from cell.base.config.places import find_configs
from cell.record.listing import list_runs
from cell.record.run import read_run
from tests.lab.studies.kit.folds import fold_strip
from tests.lab.studies.study import Quantity, Statistic, Study, Values, percentage
from tests.support.board_sessions import LENS, bent_session, session
from tests.support.touch_sessions import SETTINGS as TOUCHES, Camera, touched

HARMLESS = 0.003  # m that a displacement may be misread, as in the study of faults
WATCH = 900.0  # s in which a command must have ended, on a loaded machine
MEMORY = 1_500  # MB at most, for a file that is refused
BOARD = BoardSettings()
GIGABYTE = 1 << 30
Told = Mapping[str, Any]


def _session_with_board(kind: str, rng: np.random.Generator) -> Told:
    """Verdict on a session with a bent, shaken, misprinted or frontal board, or a good
    one.
    """
    seed, length, size = int(rng.integers(1000)), BOARD.width, LENS.size
    if kind == "board bent":
        views = bent_session(BOARD, rng.uniform(0.001, 0.004), seed)
    else:
        noise = rng.uniform(1.0, 2.0) if kind == "board shaken" else 0.05
        lean = 0.0 if kind == "board frontal" else None
        views = session(BOARD, lean=lean, noise=noise, seed=seed)
    if kind == "board misprinted":
        length *= 1.0 + rng.choice([-1, 1]) * rng.uniform(0.01, 0.05)
    return _judged(kind, lens_verdict(views, size, length, BOARD).reasons)


def _session_with_touches(kind: str, rng: np.random.Generator) -> Told:
    """Verdict on touches by a mirrored arm, a loose pointer or a moved camera, or good
    ones.
    """
    camera, angle = Camera.drawn(rng), rng.uniform(0, 2 * np.pi)
    moved = rng.uniform(5e-4, 5e-3) * np.array([np.sin(angle), np.cos(angle), 0.0])
    made = touched(
        camera,
        rng,
        nudge=moved if kind == "camera moved" else None,
        after=int(rng.integers(5, 20)),
        mirrored=kind == "touches mirrored",
        wild=0.4 if kind == "pointer loose" else 0.1,
    )
    verdict = touch_verdict(made, camera.lens, TOUCHES)
    named = () if kind.startswith("good") else tuple(verdict.wild.values())
    return _judged(kind, verdict.reasons or named)


def _judged(kind: str, reasons: tuple[str, ...]) -> Told:
    """A mishap is to be told, a good session to pass."""
    good = bool(reasons) is not kind.startswith("good")
    return {"told": good, "whole": True, "said": "; ".join(reasons)[:200]}


def _strip(kind: str, rng: np.random.Generator) -> Told:
    """A fold of another strip than was stated."""
    stated = find_configs(None).strip("denim")
    changes: Mapping[str, Mapping[str, Any]] = {
        "strip short": {"length": stated.length - rng.uniform(0.004, 0.05)},
        "strip long": {"length": stated.length + rng.uniform(0.004, 0.03)},
        "strip thick": {"thickness": rng.uniform(0.002, 0.004)},
        "strip of another colour": {"colour": tuple(rng.integers(0, 255, 3).tolist())},
        "strip stiff": {"bending_length": rng.uniform(0.03, 0.04)},
    }
    plant = stated.model_copy(update=changes[kind])
    with TemporaryDirectory() as place:
        seed = int(rng.integers(1000))
        result = fold_strip("denim", "adaptive", seed, Path(place), plant=plant)
    seen, true = result.displacement, result.displacement_true
    right = seen is not None and true is not None and abs(seen - true) < HARMLESS
    told = bool(right or result.warning or result.exit_code)
    said = f"{result.outcome}: {result.reason}"
    return {"told": told, "whole": True, "said": said[:200]}


def _killed(kind: str, rng: np.random.Generator) -> Told:
    """A command that is killed at a moment at random, and given again."""
    with TemporaryDirectory() as name:
        place, runs = Path(name), Path(name) / "runs"
        _ended(place, KILLED[kind](place), after=float(rng.uniform(2.0, 40.0)))
        listed = list_runs(runs) if runs.is_dir() else ()
        whole = all(read_run(row.folder).header.strip == "denim" for row in listed)
        told = _ended(place, KILLED[kind](place))
    return {**told, "told": told["code"] in (0, 1), "whole": whole}


def _train(place: Path) -> str:
    tiny = "--generations 4 --population 4 --strips 1 --grid 2 --jobs 1"
    return f"train {tiny} --out {place}/training"


def _fold(place: Path) -> str:
    """A fold, or where there are some the list of them."""
    if (place / "runs").exists():
        return f"runs --runs {place}/runs"
    return f"fold --strip denim --policy triangular --runs {place}/runs"


def _calibrate(place: Path) -> str:
    """A session of the camera wizard, or the rest of it."""
    way = "--resume" if (place / "lens").exists() else "--out"
    return f"calibrate camera --viz off {way} {place}/lens"


KILLED: Mapping[str, Callable[[Path], str]] = {
    "training killed": _train,
    "fold killed": _fold,
    "wizard killed": _calibrate,
}


def _bomb(kind: str, _rng: np.random.Generator) -> Told:
    """A small file that unpacks to a gigabyte, given to the command that reads it."""
    with TemporaryDirectory() as place:
        told = _ended(Path(place), BOMBS[kind](Path(place)))
    lines = told["said"].splitlines()
    refused = told["code"] == 2 and len(lines) == 1 and lines[0].startswith("cell: ")
    return {**told, "told": refused and told["memory"] < MEMORY, "whole": True}


def _guess(file: Path) -> str:
    """Command that reads a foreign file to propose a mapping."""
    return f"import {file} --guess --out {file}.yaml"


def _weights(place: Path) -> str:
    with (
        zipfile.ZipFile(place / "w.npz", "w", zipfile.ZIP_DEFLATED) as file,
        file.open("weights.npy", "w", force_zip64=True) as entry,
    ):
        for _ in range(64):
            entry.write(bytes(GIGABYTE // 64))
    return f"fold --strip denim --checkpoint {place}/w.npz"


def _parquet(place: Path) -> str:
    zeros = np.zeros(GIGABYTE // 64)
    pq.write_table(pa.table({"t": zeros, "x": zeros}), place / "t.parquet")
    return _guess(place / "t.parquet")


def _mcap(place: Path, compression: str) -> str:
    from mcap.writer import CompressionType, Writer

    with (place / "a.mcap").open("wb") as file:
        kind = CompressionType[compression]
        writer = Writer(file, chunk_size=GIGABYTE, compression=kind)
        writer.start()
        schema = writer.register_schema("q", "jsonschema", b"{}")
        channel = writer.register_channel("/q", "json", schema)
        for t in range(8):
            writer.add_message(channel, t, b" " * (GIGABYTE // 32), t)
        writer.finish()
    return _guess(place / "a.mcap")


def _foreign_archive(place: Path) -> str:
    with zipfile.ZipFile(place / "runs.zip", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("../../ticks.csv", bytes(GIGABYTE // 16))
    return _guess(place / "runs.zip")


def _aliases(place: Path) -> str:
    rows = [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12)]
    (place / "s.yaml").write_text("\n".join(["a0: &a0 [x]", *rows]))
    return f"fold --strip {place}/s.yaml --dry-run"


BOMBS: Mapping[str, Callable[[Path], str]] = {
    "bomb of weights (npz)": _weights,
    "bomb of a table (parquet)": _parquet,
    "bomb of a log (mcap, zstd)": lambda place: _mcap(place, "ZSTD"),
    "bomb of a log (mcap, lz4)": lambda place: _mcap(place, "LZ4"),
    "bomb of an archive (zip)": _foreign_archive,
    "bomb of aliases (yaml)": _aliases,
}


def _ended(place: Path, words: str, after: float = WATCH) -> dict[str, Any]:
    """Exit code, words and memory [MB] of a command, killed `after` some time [s]."""
    command = [sys.executable, "-m", "cell", *shlex.split(words)]
    environment = os.environ | {"XDG_DATA_HOME": str(place / "data")}
    with (place / "said").open("w+") as said:
        process = subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=said
        )
        watch = threading.Timer(after, process.kill)
        watch.start()
        _, status, usage = os.wait4(process.pid, 0)
        watch.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    text, memory = (place / "said").read_text(), usage.ru_maxrss / 1000
    return {"code": process.returncode, "said": text[-300:], "memory": memory}


BOARDS = ("board bent", "board shaken", "board misprinted", "board frontal")
CAMPAIGNS: Mapping[str, Callable[[str, np.random.Generator], Told]] = {
    **dict.fromkeys([*BOARDS, "good board"], _session_with_board),
    **dict.fromkeys(
        ["touches mirrored", "camera moved", "pointer loose", "good touches"],
        _session_with_touches,
    ),
    **dict.fromkeys(BOMBS, _bomb),
    **dict.fromkeys(
        [
            "strip short",
            "strip long",
            "strip thick",
            "strip of another colour",
            "strip stiff",
        ],
        _strip,
    ),
    **dict.fromkeys(KILLED, _killed),
}


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through all mishaps, each with a seed of its own."""
    return {
        "mishap": list(CAMPAIGNS)[number % len(CAMPAIGNS)],
        "seed": int(rng.integers(2**31)),
    }


def measure(case: Values) -> Values:
    """Whether a mishap was told and left all whole, what was said, and the wall time
    [s].
    """
    begun, kind = time.monotonic(), str(case["mishap"])
    told = dict(CAMPAIGNS[kind](kind, np.random.default_rng(case["seed"])))
    seconds = time.monotonic() - begun
    return told | {"seconds": seconds, "ended": seconds < WATCH}


STUDY = Study(
    name="mishaps",
    question="Which mishaps of persons, strips, kills and files pass in silence?",
    draw=draw,
    measure=measure,
    by=("mishap",),
    quantities=(
        percentage("told", bar=100.0),
        percentage("whole", bar=100.0),
        percentage("ended", bar=100.0),
        Quantity("seconds", Statistic.WORST_SIZE, "s", 1.0, label="longest"),
    ),
    usual=4 * len(CAMPAIGNS),
    quick=9,
    seconds=10.0,
    limit=3 * WATCH,
)
