"""The command `exam`: hides causes in plants and scores the workflow's verdicts."""

import os
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

from cell.interface.cli.options import Cluster, engine, resumable

CASE_TIMEOUT = 7200.0  # s of a case, runs through images included
OUT_HELP = "Folder of keys, runs, verdicts, ledger [default: runs/exam-TIER-SEED]."

Count = Annotated[
    int | None,
    typer.Option(min=1, help="Cases [default: 300, 90 through images, 6 small]."),
]
Hidden = Annotated[
    Literal["nothing", "single", "pair", "outside"] | None,
    typer.Option(
        help="Only cases that hide this [default: all kinds, in their shares]."
    ),
]
Force = Annotated[
    float | None,
    typer.Option(
        min=0.0001,
        max=5.0,
        help=(
            "Noise [N] of the strip's force, with as much left by each tare [default:"
            " no force]."
        ),
    ),
]


def exam(
    out: Annotated[Path | None, typer.Option(help=OUT_HELP)] = None,
    tier: Annotated[
        Literal["state", "images", "small"],
        typer.Option(
            help="From the state, through images, or six cases from the state."
        ),
    ] = "small",
    cases: Count = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the cases.")] = 0,
    repeats: Annotated[
        int,
        typer.Option(
            min=1, max=8, help="Times that each motion is made, from the state."
        ),
    ] = 1,
    kind: Hidden = None,
    force: Force = None,
    jobs: Annotated[int, typer.Option(min=1, help="Cases side by side.")] = 1,
    cluster: Cluster = None,
    again: Annotated[
        bool,
        typer.Option(
            "--again", help="Judge anew what OUT already holds; runs are kept."
        ),
    ] = False,
) -> None:
    """Hide causes in plants, let the workflow find them, and hold its verdicts against
    the key.

    What is finished is kept in OUT, with the report exam.md: an exam that was
    interrupted goes on where it stopped, on another machine if its ledger.jsonl goes
    with it. Of the small exam, the exit code is 1 for a name where nothing is hidden,
    and where more than one case in six is not right.
    """
    from rich.console import Console

    from cell.base.campaign.progress import Meter
    from drivers.base.errors import ConfigurationError
    from tests.lab.exam.cases import load_or_draw
    from tests.lab.exam.page import GOOD_RESULTS, write_report
    from tests.lab.exam.run import run_exam, summarise

    console = Console(stderr=True)
    out, wide = (
        out or Path("runs") / f"exam-{tier}-{seed}",
        min(jobs, os.cpu_count() or 1),
    )
    chosen = engine(wide, cluster, CASE_TIMEOUT)
    if out.exists() and not out.is_dir():
        raise ConfigurationError(f"--out: {out} is a file; name a folder")
    with resumable(out), Meter(console, summarise) as meter:
        wanted = load_or_draw(
            out, tier, cases, seed, repeats, kind, force, _print_progress, wide
        )
        entries = run_exam(wanted, out, engine=chosen, meter=meter, again=again)
    command = _repeat_command(tier, len(wanted), seed, repeats, kind, force)
    page = out / "exam.md"
    write_report(entries, page, command)
    results = [e.outcome.result if e.outcome else "failed" for e in entries]
    failed, wrong = results.count("failed"), sum(r not in GOOD_RESULTS for r in results)
    words = f"{len(results) - wrong} of {len(results)} right"
    sys.stdout.write(
        f"{words}{f', {failed} without a verdict' if failed else ''}: {page}\n"
    )
    sys.exit(
        int(tier == "small" and (6 * wrong > len(results) or "false_alarm" in results))
    )


def _repeat_command(
    tier: str,
    count: int,
    seed: int,
    repeats: int,
    kind: str | None,
    force: float | None,
) -> str:
    """Command line that repeats the same exam."""
    again = f" --repeats {repeats}" if repeats > 1 else ""
    again += f" --kind {kind}" if kind else ""
    again += f" --force {force:g}" if force else ""
    return (
        f"python -m tests.lab exam --tier {tier} --cases {count} --seed {seed}{again}"
    )


def _print_progress(done: int, total: int, text: str) -> None:
    if text:
        sys.stderr.write(f"{done}/{total}  {text}\n")
