"""Tests in ledgers of exams and studies whether stated confidences came true.

python -m tests.lab measure-confidence LEDGER... [--fresh LEDGER]... [--fit FILE]

Prints two reliability tables: what this version states of the signs of verdicts, and
what a calibration of all other cases states. --kind is strip or mechanism, by whose
file the signs count. With --fresh there is a third: what the calibration of the first
ledgers states of those. With --fit that calibration is written to FILE, as
cell/gap/verdict/confidence.yaml holds it.
"""

import sys
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from cell.gap.verdict.confidence import LogOddsCalibration, calibration
from drivers.base.files import replace_file
from drivers.base.readers import MEGABYTE, read_json_lines
from drivers.base.yaml_text import dump_yaml
from tests.lab.studies.catalogue.confidence import (
    calibrate,
    leave_each_out,
    names,
    reliable,
    shares,
)
from tests.lab.studies.study import Values

LARGEST_LEDGER = 512 * MEGABYTE
Ledgers = Annotated[list[Path], typer.Argument(exists=True, dir_okay=False)]
Fresh = Annotated[list[Path] | None, typer.Option(exists=True, dir_okay=False)]


def main(
    ledgers: Ledgers, fresh: Fresh = None, fit: Path | None = None, kind: str = "strip"
) -> int:
    """Print the tables of verdicts on a `kind` of subject; 1 where no verdict names."""
    claims = verdicts_in(ledgers)
    found, outside = names(claims)
    if not found:
        sys.stderr.write(
            "no verdict in these ledgers accepts an effect and has signs; give others\n"
        )
        return 1
    by = calibration(kind)
    counts = shares(found, outside)
    tables = {
        "Stated by this version": (
            [(by.probability(n.signs), n.right) for n in found],
            counts,
        ),
        "Left out one by one": (leave_each_out(found, counts, kind), counts),
    }
    content = dict(calibrate(claims, kind))
    if fresh:
        fitted = LogOddsCalibration.model_validate(content)
        others, outside = names(verdicts_in(fresh))
        stated = [(fitted.probability(n.signs), n.right) for n in others]
        tables["Of fresh cases"] = stated, shares(others, outside)
    for title, (stated, counts) in tables.items():
        sys.stdout.write(f"{title}:\n\n{reliable(stated, counts)}\n\n")
    sys.stdout.write(f"{content['source']}\n")
    if fit:
        names_of = ", ".join(path.name for path in ledgers)
        content["source"] += f" From {names_of}."
        content.pop("belongs_to")
        replace_file(fit, dump_yaml(content).encode())
    return 0


def verdicts_in(ledgers: Sequence[Path]) -> list[Values]:
    """Claims of the verdicts in `ledgers`, JSON lines of exams or of studies.

    A case that was judged again counts once, as last judged; signs of a version that
    knew others than today's are left out.
    """
    found: dict[str, Values] = {}
    for line in chain(*(read_json_lines(path, LARGEST_LEDGER) for path in ledgers)):
        claim = line.get("values", line).get("claim")
        if claim:
            found[claim["case"]] = claim
    return list(found.values())
