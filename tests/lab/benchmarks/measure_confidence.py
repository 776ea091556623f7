"""Tests in ledgers of exams and studies whether stated confidences came true.

python -m tests.lab measure-confidence LEDGER... [--fresh LEDGER]... [--fit FILE]

Prints two reliability tables: what this version states of the signs of verdicts, and
what a calibration of all other cases states. --kind is strip or mechanism, by whose
file the signs count. With --fresh there is a third: what the calibration of the first
ledgers states of those. With --fit that calibration is written to FILE, as
cell/gap/verdict/confidence.yaml holds it.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from cell.gap.verdict.confidence import Calibration, calibration
from cell.gap.verdict.schema import VerdictEvidence
from drivers.base.files import replace_file
from drivers.base.readers import MEGABYTE, read_json_lines
from drivers.base.yaml_text import dump_yaml
from tests.lab.exam.score import RIGHT_RESULTS
from tests.lab.studies.catalogue.confidence import (
    calibrate,
    leave_each_out,
    names,
    names_that_are_right,
    reliable,
    shares,
)
from tests.lab.studies.catalogue.mechanisms import accepted
from tests.lab.studies.study import Case, Outcome, Values

LARGEST_LEDGER = 512 * MEGABYTE
SIGNS = set(VerdictEvidence.model_fields)
Ledgers = Annotated[list[Path], typer.Argument(exists=True, dir_okay=False)]
Fresh = Annotated[list[Path] | None, typer.Option(exists=True, dir_okay=False)]


def main(
    ledgers: Ledgers, fresh: Fresh = None, fit: Path | None = None, kind: str = "strip"
) -> int:
    """Print the tables of verdicts on a `kind` of subject; 1 where no verdict names."""
    outcomes = verdicts_in(ledgers)
    found, outside = names(outcomes)
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
    content = dict(calibrate(outcomes, kind))
    if fresh:
        outcomes = verdicts_in(fresh)
        fitted, (others, outside) = Calibration.model_validate(content), names(outcomes)
        claims = [(fitted.probability(n.signs), n.right) for n in others]
        tables["Of fresh cases"] = claims, shares(others, outside)
    for title, (claims, counts) in tables.items():
        sys.stdout.write(f"{title}:\n\n{reliable(claims, counts)}\n\n")
    sys.stdout.write(f"{content['source']}\n")
    if fit:
        names_of = ", ".join(path.name for path in ledgers)
        content["source"] += f" From {names_of}."
        content.pop("belongs_to")
        replace_file(fit, dump_yaml(content).encode())
    return 0


def verdicts_in(ledgers: Sequence[Path]) -> list[Outcome]:
    """Read the scored verdicts from `ledgers`, JSON lines of exams or of the study.

    A case that was judged again counts once, as last judged; a case of an exam is named
    after its ledger too: seeds of one number may have drawn others there. Verdicts from
    before one of today's signs was kept have none.
    """
    found: dict[str, Values] = {}
    for path in ledgers:
        for line in read_json_lines(path, LARGEST_LEDGER):
            if "values" in line:  # of a study of mechanisms
                case = f"{line['seed']}/{line['number']}"
                found[case] = accepted(line["case"], line["values"])
            elif line["outcome"] is not None:
                case = f"{path.stem}/{line['outcome']['case']}"
                found[case] = _of_exam(line)
    every = enumerate(found.items())
    return [Outcome(Case(i, 0, {}), {**v, "case": case}) for i, (case, v) in every]


def _of_exam(line: Mapping[str, Any]) -> Values:
    """Facts on the verdict in a line of an exam's ledger, as for confidence."""
    scored, without = line["outcome"], line.get("without", [])
    signs = scored.get("signs") or {}
    return {
        **scored,
        "offered": line.get("offered"),
        "signs": signs if signs.keys() == SIGNS else None,
        "without": without,
        "accepted": scored["classes"],
        "right": names_that_are_right(scored["answer"]),
        "is_named": scored["verdict"] == "named",
        "is_right": scored["result"] in RIGHT_RESULTS and not without,
    }
