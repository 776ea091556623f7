"""Replays runs as measured, under the refitted base, and under the accepted model."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import requests
from cell.gap.subject.scene import Draws, Scene
from cell.gap.verdict.findings import Findings


@dataclass(frozen=True, slots=True)
class Replayed:
    """A run as measured and as simulated; `after` is None where no effect was accepted."""

    name: str
    held_out: bool
    measured: Scene
    before: Scene | None
    after: Scene | None


def replay(found: Findings, *, held_out_only: bool = False) -> Iterator[Replayed]:
    """Simulate runs under the refitted base and the accepted model, held-out ones first."""
    subject, shown = found.subject, found.shown
    if not isinstance(subject, Draws):
        return
    pairs = [(True, shown.before, shown.after if shown.changed else None)]
    if not held_out_only:
        base, best = found.base.estimate, found.accepted.estimate
        pairs.append((False, base, best if best.model.effects else None))
    for held_out, before, after in pairs:
        runs = before.evidence.runs
        scenes_before = _scenes(subject, before)
        scenes_after = [None] * len(runs) if after is None else _scenes(subject, after)
        for run, old, new in zip(runs, scenes_before, scenes_after, strict=True):
            yield Replayed(run.name, held_out, subject.draw_measured(run), old, new)


def _scenes(subject: Draws, estimate: Estimate) -> Sequence[Scene | None]:
    asked = requests(estimate.model, estimate.evidence.runs, estimate.point)
    return subject.draw_simulated(asked)
