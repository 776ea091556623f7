"""What a subject may draw of its runs: each as it was measured, and as a model has it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import requests
from cell.gap.subject.subject import Request, Run
from cell.gap.verdict.findings import Findings
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve that moves: at each of the times `t` (m,) [s] its points (k, 2), x and z [m]."""

    t: Array
    points: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class Track:
    """A point that moves: at the times `t` (m,) [s] it is at `places` (m, 2), x and z [m]."""

    t: Array
    places: Array


@dataclass(frozen=True, slots=True)
class Signal:
    """A number over time, at `t` (m,) [s]; signals of one title share a plot."""

    title: str
    t: Array
    values: Array


@dataclass(frozen=True, slots=True)
class Scene:
    """A run as it was measured, or as a model has it; `tracks` by name, `events` [s, words]."""

    signals: tuple[Signal, ...]
    curve: Curve | None = None
    tracks: Mapping[str, Track] = field(default_factory=dict)
    events: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Replayed:
    """A run measured and simulated; `after` is None where no effect was accepted, and both
    simulations where the model found no motion.
    """

    name: str
    held_out: bool
    measured: Scene
    before: Scene | None
    after: Scene | None


@runtime_checkable
class Draws(Protocol):
    """A subject that can draw its runs."""

    def measured(self, run: Run) -> Scene:
        """The run as it was measured."""
        ...

    def simulated(self, requests: Sequence[Request]) -> Sequence[Scene | None]:
        """Simulations beside what was measured; None where there is no motion."""
        ...


def replayed(found: Findings, *, held_out_only: bool = False) -> Iterator[Replayed]:
    """Runs under the refitted base and the accepted model, held-out ones first."""
    subject, shown = found.subject, found.shown
    if not isinstance(subject, Draws):
        return
    pairs = [(True, shown.before, None if shown.after is shown.before else shown.after)]
    if not held_out_only:
        base, best = found.fitted.base.estimate, found.judged.found.accepted.estimate
        pairs.append((False, base, best if best.model.effects else None))
    for held_out, before, after in pairs:
        runs = before.evidence.runs
        was = _scenes(subject, before)
        now = [None] * len(runs) if after is None else _scenes(subject, after)
        for run, old, new in zip(runs, was, now, strict=True):
            yield Replayed(run.name, held_out, subject.measured(run), old, new)


def _scenes(subject: Draws, estimate: Estimate) -> Sequence[Scene | None]:
    asked = requests(estimate.model, estimate.evidence.runs, estimate.point)
    return subject.simulated(asked)
