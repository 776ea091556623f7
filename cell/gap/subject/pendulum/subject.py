"""The pendulum as a subject of the gap workflow."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, cast

import numpy as np

from cell.gap.subject.interpolate import interpolate
from cell.gap.subject.pendulum.chain import fastest, swings
from cell.gap.subject.pendulum.dynamics import swing
from cell.gap.subject.pendulum.file import PendulumFile
from cell.gap.subject.pendulum.runs import Swing, make_run, read_run
from cell.gap.subject.pendulum.scope import check_effects, scope
from cell.gap.subject.run_folders import HEAD, RunFolder, check_indices
from cell.gap.subject.scene import Scene, Signal
from cell.gap.subject.subject import Experiment, Request, Residuals, Run
from drivers.settings import load, read_yaml
from drivers.types import Array

BATCH = 768  # swings integrated at once: their arrays stay in the cache
SWING_STEP = 0.08  # rad of the fastest small swing in one step


def patch_file(
    pendulum: PendulumFile,
    base: Mapping[str, float],
    effects: Mapping[str, Mapping[str, float]],
    source: str,
) -> dict[str, object]:
    """File content with refitted base values and named effects; old values in provenance."""
    content: dict[str, Any] = pendulum.model_dump(mode="json", by_alias=True)
    notes = list(content.pop("provenance"))
    known = dict(content.pop("effects"))
    for name, value in base.items():
        if "." in name:
            effect, key = name.split(".")
            notes.append(_note(f"effects.{effect}.{key}", known[effect][key], source))
            known[effect] = {**known[effect], key: value}
            continue
        key, number = name.rsplit("_", 1)
        link = content["links"][int(number) - 1]
        notes.append(_note(f"links.{int(number) - 1}.{key}", link[key], source))
        link[key] = value
    for effect, values in effects.items():
        notes.append({"key": f"effects.{effect}", "source": source, "note": "was absent"})
        known[effect] = dict(values)
    return {**content, "effects": known, "provenance": notes}


def _note(key: str, old: float, source: str) -> dict[str, str]:
    return {"key": key, "source": source, "note": f"was {old:.9g}"}


def load_pendulum(path: Path) -> PendulumFile:
    """Read the pendulum file at `path`.

    Raises ConfigurationError where it is broken, or names an effect that the library lacks.
    """
    pendulum = load(path, PendulumFile)
    check_effects(pendulum, str(path))
    return pendulum


class Pendulum:
    """Measured swings of one pendulum, simulated by its chain of links."""

    def __init__(self, pendulum: PendulumFile, runs: Sequence[Run], jobs: int = 1) -> None:
        self._jobs = jobs
        self.file, self.name = pendulum, pendulum.name
        self.runs = tuple(runs)
        self.scope = scope(pendulum)
        self.notes: Sequence[str] = ()  # a swing that stops early is a shorter swing
        self._step = SWING_STEP / fastest(pendulum)

    def simulate(self, requests: Sequence[Request]) -> list[Residuals]:
        """Measured minus simulated angles; what starts or ends wild is lost, not an error."""
        groups: dict[bool, list[int]] = defaultdict(list)
        for i, request in enumerate(requests):
            groups["pivot_compliance" in self._effects(request)].append(i)
        batches: list[list[int]] = []
        for members in groups.values():
            members.sort(key=lambda i: _content(requests[i].run).t[-1])
            batches += [members[at : at + BATCH] for at in range(0, len(members), BATCH)]
        found: dict[int, Residuals] = {}
        with ThreadPoolExecutor(self._jobs) as pool:
            asked = [[requests[i] for i in batch] for batch in batches]
            for batch, answers in zip(batches, pool.map(self._together, asked), strict=True):
                found.update(zip(batch, answers, strict=True))
        return [found[i] for i in range(len(requests))]

    def _effects(self, request: Request) -> dict[str, Array]:
        """Effects of a request, those that its file already has among the base included."""
        accepted: dict[str, list[float]] = defaultdict(list)
        for p, value in zip(self.scope.base, request.base, strict=True):
            if "." in p.name:
                accepted[p.name.split(".")[0]].append(float(value))
        return {**{k: np.array(v) for k, v in accepted.items()}, **request.effects}

    def _together(self, requests: Sequence[Request]) -> list[Residuals]:
        states, biases = self._swung(requests)
        return [
            _residuals(_content(r.run), states[..., i], self._step, biases[i])
            for i, r in enumerate(requests)
        ]

    def _swung(self, requests: Sequence[Request]) -> tuple[Array, Array]:
        """States (steps + 1, 2, n, B) on a grid of the step, and biases (B, n) of the encoders."""
        n = len(self.file.links)
        effects = [self._effects(r) for r in requests]
        bases = np.array([r.base[: 4 * n - 1] for r in requests])
        chain = swings(self.file, bases, effects)
        initial = np.array([r.local for r in requests])
        span = max(_content(r.run).t[-1] for r in requests)
        steps = int(np.ceil(span / self._step)) + 1
        with np.errstate(over="ignore", invalid="ignore"):
            states = swing(chain, initial[:, :n].T, initial[:, n:].T, self._step, steps)
        biases = np.zeros((len(requests), n))
        for bias, e in zip(biases, effects, strict=True):
            bias[1:] = e.get("encoder_bias", 0.0)
        return states, biases

    def draw_measured(self, run: Run) -> Scene:
        """The angles as they were measured."""
        swing = _content(run)
        return Scene(tuple(
            Signal(f"angle {i} [rad]", swing.t, row) for i, row in enumerate(swing.angles, start=1)
        ))  # fmt: skip

    def draw_simulated(self, requests: Sequence[Request]) -> list[Scene | None]:
        """The angles as simulated, and by how much those that were measured are larger."""
        return [self._scene(request) for request in requests]

    def _scene(self, request: Request) -> Scene | None:
        states, biases = self._swung([request])
        swing = _content(request.run)
        angles = interpolate(states[..., 0], swing.t, self._step)[0] + biases[0][:, None]
        if not np.isfinite(angles).all():
            return None
        found = []
        for i, (now, seen) in enumerate(zip(angles, swing.angles, strict=True), start=1):
            found.append(Signal(f"angle {i} [rad]", swing.t, now))
            found.append(
                Signal(f"angle {i}, measured - simulated [mrad]", swing.t, 1e3 * (seen - now))
            )
        return Scene(tuple(found))

    def refine(self, requests: Sequence[Request]) -> Sequence[Run]:
        """The runs as they are: a swing is integrated to far below its noise."""
        return [request.run for request in requests]

    def experiments(self) -> Sequence[Experiment]:
        """Swings worth measuring next."""
        return experiments(self.file, self.runs)

    def patch(
        self, base: Mapping[str, float], effects: Mapping[str, Mapping[str, float]], source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """The pendulum file with refitted base and named effects; a pendulum has no cell."""
        return patch_file(self.file, base, effects, source), None


def open_pendulum(path: Path, folders: Sequence[RunFolder], jobs: int = 1) -> Pendulum:
    """The pendulum of a file with its measured runs, checked."""
    pendulum = load_pendulum(path)
    found = [folder.path for folder in folders]
    runs = [read_run(folder.path, folder.name, pendulum) for folder in folders]
    check_indices(found, [read_yaml(f / HEAD).get("index") for f in found])
    runs.sort(key=lambda run: run.index)
    return Pendulum(pendulum, runs, jobs)


def _content(run: Run) -> Swing:
    return cast(Swing, run.content)


def _residuals(measured: Swing, states: Array, step: float, bias: Array) -> Residuals:
    """Residuals of one run against states (steps + 1, 2, n) on a grid of `step` [s]."""
    wild = np.abs(states).max(initial=0.0) > 1e3 or not np.isfinite(states).all()
    difference = measured.angles - interpolate(states, measured.t, step)[0] - bias[:, None]
    counts = np.diff(measured.edges)
    first = measured.edges[:-1]
    mean = np.add.reduceat(difference, first, axis=1) / counts
    square = np.add.reduceat(difference**2, first, axis=1) / counts
    if wild:
        mean, square = np.full_like(mean, np.nan), np.full_like(square, np.nan)
    return Residuals(mean.ravel(), square.ravel())


SET_UP = 1.0  # minutes to set the pendulum up and let it go


def experiments(pendulum: PendulumFile, runs: Sequence[Run]) -> list[Experiment]:
    """Releases from rest, each as long as the measured runs unless it says otherwise."""
    n = len(pendulum.links)
    span = float(np.median([run.samples.t[-1] for run in runs])) if runs else 5.0
    sigma = float(np.median([run.samples.reading[0] for run in runs])) if runs else 1e-3
    whole = np.ones(n)
    last = np.zeros(n)
    last[-1] = 1.0
    plans = [
        ("small swing", "let all links go together 6 degrees from hanging", 0.1 * whole, span),
        ("medium swing", "let all links go together 30 degrees from hanging", 0.5 * whole, span),
        ("large swing", "let all links go together 80 degrees from hanging", 1.4 * whole, span),
        ("long small swing", "the same from 6 degrees, three times as long", 0.1 * whole, 3 * span),
        ("hang still", "let it hang still and read the angles", 0.0 * whole, span),
    ]
    if n > 1:
        plans.append(("last link alone", "hold the others straight, lift the last link "
                      "60 degrees, let go", 1.0 * last, span))  # fmt: skip
    return [_plan_experiment(pendulum, *plan, sigma) for plan in plans]


def _plan_experiment(
    pendulum: PendulumFile, name: str, instruction: str, lift: Array, span: float, sigma: float
) -> Experiment:
    step = min(0.02, 0.05 / fastest(pendulum))
    t = np.arange(0.0, span, step)
    angles = np.repeat((np.pi + lift)[:, None], len(t), axis=1)
    run = make_run(pendulum, name, name, t, angles, sigma, np.zeros_like(angles))
    return Experiment(name, instruction, SET_UP + span / 60.0, run)
