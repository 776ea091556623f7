"""Prints digests of what the program makes, so that a step that changes nothing proves
it.

`python -m tests.same [PART...]` runs commands as a user types them, in a folder of its
own, and prints a digest a line: the same lines before and after mean the same numbers,
files and pages. Only what names a moment or a place (run folders, wall time) is left
out.
"""

import argparse
import csv
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import click
import numpy as np
import pyarrow.parquet as pq
import typer
import yaml

from cell.interface.cli.app import app
from tests.support.gap_strip_cases import folds, written
from tests.support.mechanisms import PRESCRIBED, make_arm

ROOT = Path(__file__).resolve().parents[1]
FOLD = ("fold", "--strip", "denim", "--plant", "denim", "--seed", "21")
MEASURED = ("ticks", "sights", "profile", "joints")
MOMENTS = re.compile(
    r"\d{8}T\d{6}Z?(-[\w-]+?-[0-9a-f]{4})?|\d{4}-\d\d-\d\d[T ][\d:.+]+Z?"
)
SPEEDS = re.compile(
    r"[\d.]+(&nbsp;|\s)ms|(median|, most|_days) +[\d.]+|\d+(\.\d+)? s( of c|\. H)"
)
SIZES = re.compile(r"(?m) +[\d.]+$")  # MB of a run in a list
PASSING = {"runtime", "simulations", "wall", "versions", "started", "age_days", "size"}
Digests = Iterator[tuple[str, str]]


def fold(folder: Path) -> Digests:
    """A fold on the twin, its measured tables, result, page, and the predicted fold."""
    run = _folded(folder, *FOLD)
    yield from _run(run)
    yield "report.html", _page(run / "report.html", folder)
    yield "dry run", _text(_cell(folder, *FOLD, "--dry-run"), folder)
    yield "replayed", _text(_cell(folder, "replay", str(run), "--json"), folder)


def fci(folder: Path) -> Digests:
    """A fold through the arm's client library and the emulated robot."""
    yield from _run(_folded(folder, *FOLD, "--arm", "fci"))


def wizard(folder: Path) -> Digests:
    """Sessions of both wizards on the twin, solved again from their images and
    touches.
    """
    for task in ("camera", "homography"):
        made = folder / task
        lens = (
            ()
            if task == "camera"
            else ("--lens", str(folder / "camera" / "opencv.yaml"))
        )
        asked = ("calibrate", task, "--out", str(made), "--viz", "off")
        yield f"{task} session", _text(_cell(folder, *asked, *lens), folder)
        for path in sorted(made.rglob("*.yaml")):
            yield f"{task} {path.name}", _text(path.read_text(encoding="utf-8"), folder)
        again = (
            "calibrate",
            task,
            "--from",
            str(made),
            "--out",
            str(folder / f"{task}-again"),
        )
        yield f"{task} again", _text(_cell(folder, *again), folder)


def gap(folder: Path) -> Digests:
    """The verdict on four folds by another rod with yarn friction, and its page."""
    hidden = {"bending_hysteresis": {"yield_curvature": 50.0, "stiffness_ratio": 8.0}}
    names = ("normal", "hold", "shake", "taut-lift")
    written(folder / "runs", folds(names, hidden))
    yield from _verdict(folder, "--strip", "denim")


def mechanism(folder: Path) -> Digests:
    """The verdict on an arm of MuJoCo that carries a hidden load, and its page."""

    def load(model: Any) -> None:
        model.body_mass[2] += 0.1

    file, _ = make_arm(folder, 4, load, PRESCRIBED)
    yield from _verdict(folder, "--model", str(file))


def exchange(folder: Path) -> Digests:
    """A run exported to each format and imported again."""
    written(folder / "runs", folds(("normal",)))
    run = next((folder / "runs").iterdir())
    for kind in ("lerobot", "mcap", "csv"):
        out = folder / kind
        _cell(folder, "export", str(run), "--format", kind, "--out", str(out))
        place = next(out.glob("*.mcap"), out)
        _cell(folder, "import", str(place), "--out", str(folder / f"{kind}-back"))
        for back in sorted((folder / f"{kind}-back").iterdir()):
            yield from ((f"{kind} {name}", digest) for name, digest in _run(back))


def pages(folder: Path) -> Digests:
    """Lists of runs and a comparison of two folds."""
    first = _folded(folder, *FOLD, "--policy", "triangular", "--frames", "none")
    second = _folded(folder, *FOLD, "--policy", "circular", "--frames", "none")
    listed = ("runs", "--runs", str(folder / "runs"))
    table = list(csv.DictReader(_cell(folder, *listed, "--csv").splitlines()))
    yield "runs csv", _document(table, folder)
    for name, arguments in {
        "runs": listed,
        "runs far off": (*listed, "--where", "abs(displacement) > 0.01"),
        "strips": ("strips",),
    }.items():
        yield name, _text(SIZES.sub("", _cell(folder, *arguments)), folder)
    compared = folder / "compared.html"
    _cell(folder, "report", str(first), str(second), "--out", str(compared))
    yield "compare", _page(compared, folder)


def commands(_folder: Path) -> Digests:
    """What `--help` says of every command."""
    os.environ.update(COLUMNS="100", TERM="dumb", NO_COLOR="1")
    yield from _helps("cell", typer.main.get_command(app))


PARTS: Mapping[str, Callable[[Path], Digests]] = MappingProxyType(
    {
        f.__name__: f
        for f in (commands, fold, fci, wizard, gap, mechanism, exchange, pages)
    }
)


def main() -> None:
    """Print the digests of the parts named on the command line, of all without a
    name.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument(
        "--keep", type=Path, help="keep what the parts make in this folder"
    )
    chosen = parser.parse_args()
    if unknown := set(chosen.parts) - set(PARTS):
        parser.error(
            f"unknown part {', '.join(sorted(unknown))}; allowed: {', '.join(PARTS)}"
        )
    with tempfile.TemporaryDirectory() as own:
        for name in chosen.parts or PARTS:
            folder = (chosen.keep or Path(own)) / name
            folder.mkdir(parents=True)
            for what, digest in PARTS[name](folder.resolve()):
                print(f"{digest[:16]}  {name}: {what}", flush=True)


def _cell(folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "cell", *arguments],
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "100", "TERM": "dumb", "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in (0, 1):
        said = f"cell {' '.join(arguments)}: exit {done.returncode}\n{done.stderr}"
        sys.exit(said.replace(str(folder), "FOLDER"))
    return done.stdout


def _folded(folder: Path, *arguments: str) -> Path:
    said = _cell(folder, *arguments, "--runs", str(folder / "runs"), "--json")
    run = Path(json.loads(said)["run"])  # named by a moment and by chance
    number = len(list(run.parent.iterdir()))
    return run.rename(run.with_name(f"20260101T000000Z-denim-fold-{number:04x}"))


def _run(run: Path) -> Digests:
    for name in MEASURED:
        if (path := run / f"{name}.parquet").is_file():
            yield path.name, _table(path)
    for name in ("run.yaml", "result.yaml", "truth.yaml"):
        if (path := run / name).is_file():
            yield name, _document(yaml.safe_load(path.read_text()), run)


def _verdict(folder: Path, *subject: str) -> Digests:
    out = folder / "out"
    _cell(
        folder,
        "gap",
        "fit",
        str(folder / "runs"),
        *subject,
        "--out",
        str(out),
        "--jobs",
        "1",
    )
    verdict = json.loads((out / "verdict.json").read_text())
    named = "+".join(effect["name"] for effect in verdict["effects"]) or "nothing"
    yield f"verdict.json ({verdict['verdict']}: {named})", _document(verdict, folder)
    yield "report.html", _page(out / "report.html", folder)
    for path in sorted(out.glob("*patch.yaml")):
        yield path.name, _document(yaml.safe_load(path.read_text()), folder)


def _helps(name: str, command: click.Command) -> Digests:
    with click.Context(command, info_name=name) as context:
        yield name, hashlib.sha256(command.get_help(context).encode()).hexdigest()
    for key, inner in sorted(getattr(command, "commands", {}).items()):
        yield from _helps(f"{name} {key}", inner)


def _table(path: Path) -> str:
    table = pq.read_table(path)
    made = hashlib.sha256()
    for name in sorted(table.column_names):
        column = table.column(name).to_numpy()
        if column.dtype.kind == "f":
            # a NaN has many patterns of bits
            column = np.where(np.isnan(column), np.nan, column)
        made.update(
            name.encode()
            + (
                repr(column.tolist()).encode()
                if column.dtype == object
                else column.tobytes()
            )
        )
    return made.hexdigest()


def _document(content: Any, folder: Path) -> str:
    return _text(json.dumps(_lasting(content), sort_keys=True, default=str), folder)


def _lasting(content: Any) -> Any:
    if isinstance(content, dict):
        return {k: _lasting(v) for k, v in content.items() if k not in PASSING}
    return [_lasting(v) for v in content] if isinstance(content, list) else content


def _page(path: Path, folder: Path) -> str:
    text = re.sub(
        r"data:[\w/+-]+;base64,[\w+/=]+", "", path.read_text(encoding="utf-8")
    )
    seen = re.sub(r"<(script|style)\b.*?</\1>|<[^>]*>", " ", text, flags=re.DOTALL)
    return _text(re.sub(r"\s+", " ", SPEEDS.sub("SPEED", seen)), folder)


def _text(text: str, folder: Path) -> str:
    plain = MOMENTS.sub("MOMENT", text.replace(str(folder), "FOLDER"))
    return hashlib.sha256(plain.encode()).hexdigest()


if __name__ == "__main__":
    main()
