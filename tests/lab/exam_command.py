"""The command `exam`: hides causes in plants and scores the workflow's verdicts."""

import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from cell.interface.cli.options import Cluster, engine
from tests.lab.study_command import measure_here

Count = Annotated[
    int | None,
    typer.Option(min=1, help="Cases [default: 300, 90 through images, 6 small]."),
]


def exam(
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the exam [default: runs/exam-TIER-SEED]."),
    ] = None,
    tier: Annotated[
        Literal["state", "images", "small"],
        typer.Option(
            help="From the state, through images, or six cases from the state."
        ),
    ] = "small",
    cases: Count = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the cases.")] = 0,
    jobs: Annotated[int, typer.Option(min=1, help="Cases side by side.")] = 1,
    cluster: Cluster = None,
    again: Annotated[
        bool, typer.Option("--again", help="Measure anew what OUT already holds.")
    ] = False,
) -> None:
    """Hide causes in plants, let the workflow find them, and hold its verdicts against
    the key.

    What is finished is kept in OUT, with its ledger and the report exam.md: an exam
    that was interrupted goes on where it stopped. Of the small exam, the exit code is 1
    for a name where nothing is hidden, and where more than one case in six is not
    right.
    """
    from cell.record.documents import json_line
    from drivers.base.files import replace_file
    from tests.lab.exam.page import GOOD_RESULTS, page, result
    from tests.lab.exam.run import EXAMS
    from tests.lab.studies.campaign import StudyRequest, read_study

    study = EXAMS[tier]
    folder = out or Path("runs") / f"exam-{tier}-{seed}"
    asked = StudyRequest(study, seed, cases or study.usual, folder)
    measure_here(asked, engine(jobs, cluster, study.limit), (1, 1), again=again)
    kept = read_study(asked)
    lines = (json_line(dict(each.values)) for each in kept.outcomes)
    replace_file(folder / "ledger.jsonl", b"".join(lines))
    replace_file(folder / "exam.md", page(kept).encode())
    results = [result(each) for each in kept.outcomes]
    right = sum(each in GOOD_RESULTS for each in results)
    for lost in kept.lost:
        sys.stderr.write(f"{lost.key}: {lost.reason}\n")
    sys.stdout.write(f"{right} of {asked.count} right: {folder / 'exam.md'}\n")
    failed = 6 * right < 5 * asked.count or "false_alarm" in results
    sys.exit(int(tier == "small" and failed))
