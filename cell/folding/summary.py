"""Summary of the biases that a cell has learned, for `cell learn`."""

from collections.abc import Sequence
from typing import Any

from cell.folding.bias import LIMIT, bias
from cell.folding.experience import Experience, Memory
from drivers.base.errors import in_mm


def summary_rows(experiences: Sequence[Experience]) -> list[dict[str, Any]]:
    """Rows for the summary of what a cell has learned, one for each policy, strip and
    specimen: bias [m] with its uncertainty, number of folds, and last change of the
    cell.
    """
    rows = []
    for policy, strip, specimen in dict.fromkeys(
        (e.policy, e.strip, e.specimen) for e in experiences
    ):
        mine = [one for one in experiences if one.policy == policy]
        learned = bias(mine, strip, specimen)
        folds = [one for one in mine if (one.strip, one.specimen) == (strip, specimen)]
        of_cell, of_strip, of_specimen = learned.parts
        rows.append(
            {
                "policy": policy,
                "strip": strip,
                "specimen": specimen,
                "folds": sum(one.kind == "camera" for one in folds),
                "bias": learned.seen,
                "sigma": learned.sigma,
                "cell": of_cell,
                "of_strip": of_strip,
                "of_specimen": of_specimen,
                "unseen": learned.rig,
                "laid": learned.laid,
                "since": learned.since,
            }
        )
    return rows


def summary_text(rows: Sequence[dict[str, Any]]) -> str:
    """Text of the summary in `rows`, in millimetres, with a further line for each time
    at which the cell has changed.
    """
    if not rows:
        return "nothing was learned yet\n"
    lines = [
        f"  {row['strip']}, {row['specimen']}, {row['policy']}: bias {_mm(row['bias'])}"
        f" +- {in_mm(row['sigma'], 1)} after {row['folds']} folds (cell"
        f" {_mm(row['cell'])}, strip {_mm(row['of_strip'])}, specimen"
        f" {_mm(row['of_specimen'])}); unseen by the camera {_mm(row['unseen'])} mm;"
        f" edges laid {_mm(row['laid'])} mm off"
        for row in rows
    ]
    changes = dict.fromkeys(row["since"] for row in rows if row["since"])
    lines += [
        f"  since run {run} something moved: check the calibration" for run in changes
    ]
    return "\n".join(lines) + "\n"


def largest_text(memory: Memory) -> str:
    """Text on the largest corrections with which any stored fold was made, and on the
    limit of corrections.
    """
    aim, place = memory.largest_corrections()
    return (
        f"  largest corrections so far: aimed {_mm(aim)} mm, laid the edge {_mm(place)}"
        f" mm; at most {1e3 * LIMIT:g} mm each\n"
    )


def experience_lines(experiences: Sequence[Experience]) -> str:
    """Text with one line for each fold that was learned from, the oldest first."""
    return (
        "".join(f"  {_line(one)}\n" for one in experiences)
        or "nothing was learned yet\n"
    )


def _line(one: Experience) -> str:
    """Line of text on one fold, or one measurement by ruler, that was learned from."""
    fold = f"{one.run}: {one.strip}, {one.specimen}, {one.policy}"
    if one.kind == "ruler":
        return f"{fold}: the ruler shows {_mm(one.rig)} mm more than the camera"
    edges = "" if one.edges is None else f", edges laid {_mm(one.edges)} mm off"
    return (
        f"{fold}: displacement {_mm(one.displacement)} mm beyond the predicted{edges}"
    )


def _mm(length: float) -> str:
    return f"{1e3 * length:+.1f}"
