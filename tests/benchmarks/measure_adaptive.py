"""`adaptive` over strips that nobody measured, each effect hidden in turn, told their noisy state.

python -m tests.benchmarks.measure_adaptive [--engine rod|chain] [--count N] [--only NAME,...]
    [--checkpoint FILE | --without profile|tip|memory|friction --out DIR]

Prints |d| as mean / 95 % / worst, the share of outcomes within one and 1.96 sigma of what was
foretold at the touch, and the errors of the belief. `--without` trains a critic that lacks that
first, in DIR, which takes minutes.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cell.parallel import cores, workers
from drivers.strip.describe import describe
from drivers.strip.engine import Stepper
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from drivers.types import Array
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.checkpoint import load_critic
from policies.adaptive.critic import Critic
from policies.adaptive.fabrics import EFFECTS, effect, friction, plain
from policies.adaptive.train.piece import truth
from policies.adaptive.train.settings import CriticSettings
from policies.adaptive.train.training import CriticTraining
from policies.fixed_paths import Shifted
from policies.policy import Decision, Observation
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import IMAGES, Sensing

LINKS, SEGMENTS = 80, 100
LACKING = {
    "profile": {"profile": False},
    "tip": {"tip": False},
    "memory": {"memory": 0},
    "friction": {"friction": False},
}
Draw = Callable[[np.random.Generator], StripFile]


@dataclass(frozen=True)
class Case:
    """Strips drawn by `draw`, seen as `sensing` says at `rate` [Hz]."""

    draw: Draw = plain
    sensing: Sensing = IMAGES
    rate: float = 60.0


class Watched(Adaptive):
    """Keeps what was foretold at every decision: time, d, sigma and belief of each strip."""

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        super().reset(strip, speed, count)
        self.kept: list[tuple[float, Array]] = []

    def decide(self, observation: Observation) -> Decision:
        decision = super().decide(observation)
        judged = self.judgement
        known = [judged.displacement[:, None], judged.sigma[:, None], *judged.belief]
        self.kept.append((float(observation.time[0]), np.concatenate(known, axis=1)))
        return decision

    def at(self, folds: Folds) -> Array:
        """What was foretold of each strip (n, 8) at its touch, or at the end."""
        times = np.array([time for time, _ in self.kept])
        ends = [times[-1] if touch is None else touch.time for touch in folds.touch]
        rows = np.maximum(np.searchsorted(times, ends) - 1, 0)
        return np.array([self.kept[row][1][i] for i, row in enumerate(rows)])


def with_effect(name: str) -> Draw:
    return lambda rng: plain(rng, **{name: effect(name, rng)})


def rough(low: float, high: float, *others: str) -> Draw:
    def draw(rng: np.random.Generator) -> StripFile:
        hidden = {name: effect(name, rng) for name in others}
        return plain(rng, bending_hysteresis=friction(rng, low, high), **hidden)

    return draw


def cases() -> dict[str, Case]:
    loud = replace(IMAGES, contact_sigma=0.003, tip_sigma=0.003, profile_sigma=0.003)
    found = {
        "nothing": Case(),
        "30 Hz": Case(rate=30.0),
        "3 mm noise": Case(sensing=loud),
        "half dropped": Case(sensing=replace(IMAGES, dropped=(0.5, 0.5))),
        "friction 20-60": Case(rough(20.0, 60.0)),
        "friction+seam": Case(rough(20.0, 60.0, "seam")),
        "friction 90": Case(rough(90.0, 90.1)),
        "stretch 3 N": Case(lambda rng: plain(rng, stretch={"stiffness": 3.0})),
    }
    for late in (0.01, 0.03):
        wrong = replace(IMAGES, delay_error=late)
        found[f"latency +-{1e3 * late:.0f} ms"] = Case(sensing=wrong)
    return found | {name: Case(with_effect(name)) for name in EFFECTS}


def engine(name: str) -> Stepper:
    return Rod(SEGMENTS, strict=False) if name == "rod" else Chain(LINKS)


def line(name: str, case: Case, critic: Critic, on: str, count: int) -> str:
    rng = np.random.default_rng(12345)
    strips = [case.draw(rng) for _ in range(count)]
    models = [describe(strip) for strip in strips]
    settings = Rollout(rate=case.rate, sensing=case.sensing, substeps=round(180 / case.rate))
    watched = Watched(critic)
    folds = [
        roll_out(policy, engine(on), strips[0], models, settings=settings, rng=rng)
        for policy in (watched, Shifted())
    ]
    miss, before = (np.abs(each.displacement) for each in folds)
    known = watched.at(folds[0])
    ratio = np.abs(folds[0].displacement - known[:, 0]) / known[:, 1]
    off = np.array([truth(strip) for strip in strips]) - known[:, 2::2]
    rms = np.sqrt(np.mean(off**2, axis=0))
    return (
        f"{name:18s} |d| {told(miss)} mm, shifted {told(before)}; no touch "
        f"{np.isnan(miss).sum()}; within {100 * np.mean(ratio < 1):.0f} and "
        f"{100 * np.mean(ratio < 1.96):.0f} %; belief off by {100 * rms[0]:.1f} % in length, "
        f"{100 * rms[1]:.0f} % in time, {rms[2]:.2f} in friction"
    )


def told(values: Array) -> str:
    numbers = (np.nanmean(values), np.nanquantile(values, 0.95), np.nanmax(values))
    return " / ".join(f"{1e3 * number:.2f}" for number in numbers)


def trained_without(part: str, folder: Path) -> Critic:
    training = CriticTraining(CriticSettings(**LACKING[part]), folder)
    with workers(cores()) as executor:
        for step in training.run(executor):
            print(f"{step.done} of {step.total}: {step.said}", flush=True)
    return training.finished


def main(given: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engine", choices=["rod", "chain"], default="rod")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--only", default="")
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--without", choices=list(LACKING))
    parser.add_argument("--out", type=Path, default=Path("runs/training/ablation"))
    asked = parser.parse_args(given)
    if asked.without is not None:
        critic = trained_without(asked.without, asked.out / asked.without)
    else:
        critic = load_critic(asked.checkpoint)
    wanted = [name.strip() for name in asked.only.split(",") if name.strip()]
    for name, case in cases().items():
        if not wanted or name in wanted:
            print(line(name, case, critic, asked.engine, asked.count), flush=True)


if __name__ == "__main__":
    main()
