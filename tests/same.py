"""Prints digests of what the program makes, so that a step that changes nothing proves
it.

`python -m tests.same [PART...]` runs commands as a user types them, in a folder of its
own, and prints a digest for what each part printed and for each file that it left: the
same lines before and after mean the same numbers, files and pages. Only what names a
moment or a place (run folders, wall time) is left out.
"""

import argparse
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

FOLD = ("fold", "--strip", "denim", "--plant", "denim", "--seed", "21")
PLAIN = {"COLUMNS": "100", "TERM": "dumb", "NO_COLOR": "1"}
PASSING = {"runtime", "simulations", "wall", "versions", "started", "age_days", "size"}
PASSING_TEXT = re.compile(
    r"\d{8}T\d{6}Z?(-[\w-]+?-[0-9a-f]{4})?|\d{4}-\d\d-\d\d[T ][\d:.+]+Z?"  # moments
    r"|[\d.]+(&nbsp;|\s)ms|(median|, most|_days) +[\d.]+|\d+(\.\d+)? s( of c|\. H)"
    r"|(?m: +[\d.]+$)"  # MB of a run in a list
)
Said = Iterator[str]


def fold(folder: Path) -> Said:
    """A fold on the twin, its measured tables, result, page, and the predicted fold."""
    run = _folded(folder, *FOLD)
    yield _cell(folder, "report", str(run))
    yield _cell(folder, *FOLD, "--dry-run")
    yield _cell(folder, "replay", str(run), "--json")


def fci(folder: Path) -> Said:
    """A fold through the arm's client library and the emulated robot."""
    yield str(_folded(folder, *FOLD, "--arm", "fci"))


def wizard(folder: Path) -> Said:
    """Sessions of both wizards on the twin, solved again from their images and
    touches.
    """
    lens = ("--lens", f"{folder}/camera/opencv.yaml")
    for task, known in {"camera": (), "homography": lens}.items():
        made, command = f"{folder}/{task}", ("calibrate", task)
        yield _cell(folder, *command, "--out", made, "--viz", "off", *known)
        yield _cell(folder, *command, "--from", made, "--out", f"{made}-again")


def gap(folder: Path) -> Said:
    """The verdict on four folds by another rod with yarn friction, and its page."""
    hidden = {"bending_hysteresis": {"yield_curvature": 50.0, "stiffness_ratio": 8.0}}
    written(folder / "runs", folds(("normal", "hold", "shake", "taut-lift"), hidden))
    yield _fitted(folder, "--strip", "denim")


def mechanism(folder: Path) -> Said:
    """The verdict on an arm of MuJoCo that carries a hidden load, and its page."""

    def load(model: Any) -> None:
        model.body_mass[2] += 0.1

    file, _ = make_arm(folder, 4, load, PRESCRIBED)
    yield _fitted(folder, "--model", str(file))


def exchange(folder: Path) -> Said:
    """A run exported to each format and imported again."""
    written(folder / "runs", folds(("normal",)))
    run = next((folder / "runs").iterdir())
    for kind in ("lerobot", "mcap", "csv"):
        out = folder / kind
        yield _cell(folder, "export", str(run), "--format", kind, "--out", str(out))
        place = next(out.glob("*.mcap"), out)
        yield _cell(folder, "import", str(place), "--out", f"{out}-back")


def pages(folder: Path) -> Said:
    """Lists of runs and a comparison of two folds."""
    first, second = (
        str(_folded(folder, *FOLD, "--policy", policy, "--frames", "none"))
        for policy in ("triangular", "circular")
    )
    listed = ("runs", "--runs", f"{folder}/runs")
    yield _cell(folder, *listed, "--csv")
    yield _cell(folder, *listed, "--where", "abs(displacement) > 0.01")
    yield _cell(folder, "strips")
    yield _cell(folder, "report", first, second, "--out", f"{folder}/compared.html")


def commands(_folder: Path) -> Said:
    """What `--help` says of every command."""
    os.environ.update(PLAIN)
    yield from _helps("cell", typer.main.get_command(app))


PARTS: Mapping[str, Callable[[Path], Said]] = MappingProxyType(
    {
        part.__name__: part
        for part in (commands, fold, fci, wizard, gap, mechanism, exchange, pages)
    }
)


def main() -> None:
    """Print the digests of the parts named on the command line, of all without a
    name.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--keep", type=Path, help="keep what the parts make here")
    chosen = parser.parse_args()
    if unknown := set(chosen.parts) - {*PARTS}:
        parser.error(f"unknown part {unknown}; allowed: {', '.join(PARTS)}")
    with tempfile.TemporaryDirectory() as own:
        for name in chosen.parts or PARTS:
            folder = (chosen.keep or Path(own)).resolve() / name
            folder.mkdir(parents=True)
            for what, text in _lasting(PARTS[name], folder):
                plain = PASSING_TEXT.sub("", text.replace(str(folder), "FOLDER"))
                digest = hashlib.sha256(plain.encode()).hexdigest()
                print(f"{digest[:16]}  {name}: {what}", flush=True)


def _lasting(part: Callable[[Path], Said], folder: Path) -> Iterator[tuple[str, str]]:
    """Yield name and text of all that a part printed, and of each file that it left."""
    for number, said in enumerate(part(folder)):
        yield f"said {number}", said
    for path in sorted(folder.rglob("*")):
        if path.suffix in READERS:
            name = PASSING_TEXT.sub("RUN", str(path.relative_to(folder)))
            yield name, READERS[path.suffix](path)


def _cell(folder: Path, *arguments: str) -> str:
    command = [sys.executable, "-m", "cell", *arguments]
    done = subprocess.run(
        command, env=os.environ | PLAIN, capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 1):
        said = f"cell {' '.join(arguments)}: exit {done.returncode}\n{done.stderr}"
        sys.exit(said.replace(str(folder), "FOLDER"))
    return done.stdout


def _folded(folder: Path, *arguments: str) -> Path:
    said = _cell(folder, *arguments, "--runs", f"{folder}/runs", "--json")
    run = Path(json.loads(said)["run"])  # named by a moment and by chance
    number = len(list(run.parent.iterdir()))
    return run.rename(run.with_name(f"20260101T000000Z-denim-fold-{number:04x}"))


def _fitted(folder: Path, *subject: str) -> str:
    made = ("--out", f"{folder}/out", "--jobs", "1")
    return _cell(folder, "gap", "fit", f"{folder}/runs", *subject, *made)


def _helps(name: str, command: click.Command) -> Said:
    with click.Context(command, info_name=name) as context:
        yield command.get_help(context)
    for key, inner in sorted(getattr(command, "commands", {}).items()):
        yield from _helps(f"{name} {key}", inner)


def _table(path: Path) -> str:
    table = pq.read_table(path).to_pydict()
    # a NaN has many patterns of bits
    return repr({name: np.array(table[name]).tolist() for name in sorted(table)})


def _document(path: Path) -> str:
    def without(content: Any) -> Any:
        if isinstance(content, dict):
            return {k: without(v) for k, v in content.items() if k not in PASSING}
        return [*map(without, content)] if isinstance(content, list) else content

    text = path.read_text(encoding="utf-8")
    if "!!opencv-matrix" in text:  # no other reads it
        return text
    return json.dumps(without(yaml.safe_load(text)), sort_keys=True, default=str)


def _page(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    text = re.sub(r"data:[\w/+-]+;base64,[\w+/=]+", "", text)
    seen = re.sub(r"<(script|style)\b.*?</\1>|<[^>]*>", " ", text, flags=re.DOTALL)
    return re.sub(r"\s+", " ", seen)


READERS: Mapping[str, Callable[[Path], str]] = MappingProxyType(
    {".parquet": _table, ".yaml": _document, ".json": _document, ".html": _page}
)

if __name__ == "__main__":
    main()
