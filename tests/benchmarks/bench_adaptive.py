"""What `adaptive` costs: a decision, the comparison with the model after a fold, and a training.

python -m tests.benchmarks.bench_adaptive [--training]

Processor time on one core. A decision must take under 5 ms in 99 % (`cell fold` at 60 Hz has
16 ms for an image). `--training` folds one piece of each kind and fits one epoch, some 30 s, and
extrapolates to the whole training.
"""

import argparse
import time

import numpy as np
from threadpoolctl import threadpool_limits

from cell.config.unknown import unknown_strip
from drivers.strip.describe import describe
from drivers.strip.rod.engine import Rod
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.checkpoint import load_critic
from policies.adaptive.fabrics import plain
from policies.adaptive.train.piece import explore, gathered
from policies.adaptive.train.regression import fit
from policies.adaptive.train.settings import CriticSettings
from policies.agreement import agreement
from policies.measured_fold import MeasuredFold
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGES
from tests.benchmarks.measure_agreement import Kept, Traced

FOLDS = 8


def decisions() -> None:
    """Times of the decisions of some folds, one strip each, as in the cell."""
    rng, costs, reviews = np.random.default_rng(0), [], []
    for _ in range(FOLDS):
        strip, policy, engine = plain(rng), Kept(load_critic()), Traced(Rod(100, strict=False))
        folds = roll_out(
            policy, engine, strip, [describe(strip)], settings=Rollout(sensing=IMAGES), rng=rng
        )
        costs += again([seen for seen, _ in policy.seen])
        touch = folds.touch[0]
        if touch is None:
            continue
        rows = [row for row in policy.seen if row[0].time[0] <= touch.time]
        stamps, curves = (
            np.array([getattr(seen, name)[0] for seen, _ in rows]) for name in ("stamp", "profile")
        )
        path = np.array(engine.poses)[:, 0]
        fold = MeasuredFold.until(touch.time, np.array(engine.times), path, stamps, curves)
        begun = time.process_time()
        agreement(unknown_strip("0.6"), rows[-1][1][0], fold)
        reviews.append(time.process_time() - begun)
    told("a decision", costs)
    told("strip and model compared, after the fold", reviews[1:])


def again(seen: list) -> list[float]:
    """Processor times [s] of the decisions on what was seen."""
    policy, found = Adaptive(load_critic()), []
    policy.reset(unknown_strip("0.6"), 0.1, 1)
    for observation in seen:
        begun = time.process_time()
        policy.decide(observation)
        policy.foretold()
        found.append(time.process_time() - begun)
    return found


def told(name: str, costs: list[float]) -> None:
    middle, most, worst = np.quantile(1e3 * np.array(costs), (0.5, 0.99, 1.0))
    print(f"{name}: median {middle:.2f}, 99 % {most:.2f}, worst {worst:.2f} ms", flush=True)


def training() -> None:
    """Cost of the whole training, from one piece of each kind and one epoch."""
    settings = CriticSettings()
    piece, first = clocked(lambda: explore(settings, 0, 0, None))
    critic, _ = clocked(lambda: fit(piece, settings, 1, 0, None))
    (later, steered) = clocked(lambda: explore(settings, 1, 0, critic))
    many = gathered([piece, later])
    _, epoch = clocked(lambda: fit(many, settings, 1, 0, critic))
    pieces = settings.pieces[0] * first
    pieces += (sum(settings.pieces[1:]) + settings.trials) * steered
    known = np.cumsum(settings.pieces) / 2
    fits = sum(n * epochs * epoch for n, epochs in zip(known, settings.epochs, strict=True))
    print(
        f"a piece {first:.1f} s, with the critic {steered:.1f} s; an epoch of two pieces "
        f"{epoch:.2f} s; the training: {pieces:.0f} s of folds, half of it on two cores, and "
        f"{fits:.0f} s of regression on one, together {(pieces / 2 + fits) / 60:.1f} minutes"
    )


def clocked(work):
    """What `work` returns, and its processor time [s]."""
    with threadpool_limits(1):
        begun = time.process_time()
        return work(), time.process_time() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--training", action="store_true")
    asked = parser.parse_args()
    decisions()
    if asked.training:
        training()


if __name__ == "__main__":
    main()
