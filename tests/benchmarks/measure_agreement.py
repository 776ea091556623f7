"""How often `adaptive` says that a strip does not behave like the model, rightly and wrongly.

python -m tests.benchmarks.measure_agreement [--engine rod|chain] [--count N] [--only NAME,...]

Folds strips as they may come, told their noisy state, compares each with a rod of what the policy
believed at the touch (`policies.agreement`), and prints the rate of false alarms, then the rate at
which strips outside of training are flagged, with |d| beside. Laws that no description of a strip
holds are there on the chain only.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cell.config.unknown import unknown_strip
from cell.exam.causes import cause_of
from drivers.strip.describe import describe
from drivers.strip.engine import Observables, Stepper
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from drivers.twin.chain.extra_forces import ForceFunction, Parts
from drivers.types import Array
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.checkpoint import load_critic
from policies.adaptive.fabrics import LENGTH, effect, plain, unknown
from policies.agreement import Agreement, agreement
from policies.foretelling import Foretold
from policies.measured_fold import MeasuredFold
from policies.policy import Decision, Observation
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGES, Sensing
from tests.benchmarks.measure_adaptive import rough, told

LINKS, SEGMENTS = 80, 100
Draw = Callable[[np.random.Generator], StripFile]


class Law:
    """A cause of the exam as a foreign law of the chain."""

    def __init__(self, name: str, **values: float) -> None:
        self._cause, self._rng = cause_of(name, values), np.random.default_rng(0)

    def begin(self, parts: Parts) -> ForceFunction:
        force = self._cause.begin(parts, self._rng)
        assert force is not None
        return force


@dataclass(frozen=True)
class Case:
    """Strips drawn by `draw`, with `law` beside; `usual` ones are those of the training."""

    usual: bool
    draw: Draw = plain
    law: Law | None = None
    sensing: Sensing = IMAGES


class Kept(Adaptive):
    """Keeps every observation and what was foretold after it."""

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        super().reset(strip, speed, count)
        self.seen: list[tuple[Observation, list[Foretold]]] = []

    def decide(self, observation: Observation) -> Decision:
        decision = super().decide(observation)
        judged = self.judgement
        beliefs = [
            type(judged.belief)(*(part[i : i + 1] for part in judged.belief)).first()
            for i in range(len(observation.x))
        ]
        each = zip(judged.displacement, judged.sigma, beliefs, strict=True)
        foretold = [Foretold(float(d), float(s), **belief, blind=False) for d, s, belief in each]
        self.seen.append((observation, foretold))
        return decision


class Traced:
    """An engine that remembers where its grippers went."""

    def __init__(self, engine: Stepper) -> None:
        self._engine = engine

    def reset(self, models: Sequence[StripModel]) -> None:
        self._engine.reset(models)
        self.times, self.poses = [0.0], [np.tile((LENGTH, 0.0, 0.0), (len(models), 1))]

    def step(self, poses: Array, dt: float) -> Observables:
        self.times.append(self.times[-1] + dt)
        self.poses.append(poses.copy())
        return self._engine.step(poses, dt)

    def shapes(self) -> Array:
        return self._engine.shapes()

    def arc(self) -> Array:
        return self._engine.arc()


def cases() -> dict[str, Case]:
    loud = replace(IMAGES, contact_sigma=0.003, tip_sigma=0.003, profile_sigma=0.003)
    late = replace(IMAGES, delay_error=0.01)
    usual = {
        "as they come": Case(usual=True, draw=unknown),
        "friction 20-60": Case(usual=True, draw=rough(20.0, 60.0)),
        "seam": Case(usual=True, draw=lambda rng: plain(rng, seam=effect("seam", rng))),
        "3 mm noise": Case(usual=True, draw=unknown, sensing=loud),
        "latency +-10 ms": Case(usual=True, draw=unknown, sensing=late),
    }
    outside = {
        "friction 90": Case(usual=False, draw=rough(90.0, 90.1)),
        "stretch 3 N": Case(usual=False, draw=lambda rng: plain(rng, stretch={"stiffness": 3.0})),
    }
    laws = {
        "draught 0.35 m/s": Law("draught", speed=0.35),
        "draught 0.55 m/s": Law("draught", speed=0.55),
        "Dahl friction 60": Law("dahl", yield_curvature=60.0),
        "softening bending": Law("sinh_bending", cubic=-2e-4),
        "stiffening bending": Law("sinh_bending", cubic=1e-3),
    }
    return usual | outside | {name: Case(usual=False, law=law) for name, law in laws.items()}


def folded(
    case: Case, on: str, count: int, rng: np.random.Generator
) -> tuple[list[Agreement], Array]:
    """Agreements of the folds that ended in a touch, and |d| (n,) [m] of all."""
    strips = [case.draw(rng) for _ in range(count)]
    foreign = () if case.law is None else (case.law,)
    chain = on == "chain"
    engine = Traced(Chain(LINKS, foreign) if chain else Rod(SEGMENTS, strict=False))
    policy, settings = Kept(load_critic()), Rollout(sensing=case.sensing)
    models = [describe(strip) for strip in strips]
    folds = roll_out(policy, engine, strips[0], models, settings=settings, rng=rng)
    times, poses, found = np.array(engine.times), np.array(engine.poses), []
    for i, touch in enumerate(folds.touch):
        if touch is None:
            continue
        rows = [row for row in policy.seen if row[0].time[i] <= touch.time]
        stamps = np.array([seen.stamp[i] for seen, _ in rows])
        new = np.concatenate([[True], np.diff(stamps) > 0])
        curves = np.array([seen.profile[i] for seen, _ in rows])
        fold = MeasuredFold.until(touch.time, times, poses[:, i], stamps[new], curves[new])
        agreed = agreement(unknown_strip(str(LENGTH)), rows[-1][1][i], fold)
        found += [] if agreed is None else [agreed]
    return found, np.abs(folds.displacement)


def line(name: str, case: Case, on: str, count: int) -> str:
    found, miss = folded(case, on, count, np.random.default_rng(2026))
    flagged = np.array([not each.like_model for each in found])
    off = 1e3 * np.array([each.residual for each in found])
    return (
        f"{name:18s} {'false alarms' if case.usual else 'flagged     '} {flagged.sum():3d} of "
        f"{count} ({100 * flagged.sum() / count:3.0f} %); residual {np.median(off):.2f}, 95 % "
        f"{np.quantile(off, 0.95):.2f}, worst {off.max():.2f} mm; |d| {told(miss)} mm"
    )


def main(given: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engine", choices=["rod", "chain"], default="chain")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--only", default="")
    asked = parser.parse_args(given)
    wanted = [name.strip() for name in asked.only.split(",") if name.strip()]
    for name, case in cases().items():
        if (asked.engine == "chain" or case.law is None) and (not wanted or name in wanted):
            print(line(name, case, asked.engine, asked.count), flush=True)


if __name__ == "__main__":
    main()
