"""How far folds roll on after the touch, on the chain: python -m tests.benchmarks.measure_roll [N].

Folds N strips drawn at random by `adaptive` from noisy states, lays them down as the cell does,
lets go, and prints d and the final offset of the edges, and the fit of `policies.adaptive.roll`.
"""

import sys
from collections.abc import Sequence

import numpy as np

from drivers.strip.describe import describe
from drivers.strip.engine import Observables
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.twin.chain.engine import Chain
from drivers.types import Array
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.checkpoint import load_critic
from policies.adaptive.fabrics import friction, plain
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGES

DT = 0.005  # s
SEEN_AFTER = 0.1  # s after the touch, when it is told
SPEED = 0.1  # m/s


class Traced:
    """A chain that remembers where its gripper went."""

    def __init__(self, links: int) -> None:
        self.chain = Chain(links)
        self.poses: list[Array] = []
        self.dt = DT

    def reset(self, models: Sequence[StripModel]) -> None:
        self.poses = []
        self.chain.reset(models)

    def step(self, poses: Array, dt: float) -> Observables:
        self.poses.append(poses[0].copy())
        self.dt = dt
        return self.chain.step(poses, dt)

    def shapes(self) -> Array:
        return self.chain.shapes()

    def arc(self) -> Array:
        return self.chain.arc()

    def along(self, poses: Array) -> None:
        for pose in poses:
            self.chain.step(pose[None], DT)


def laid(strip: StripFile, seed: int) -> tuple[float, float, Adaptive]:
    """Displacement and final offset [m] of one fold, and the policy that made it."""
    engine, policy = Traced(80), Adaptive(load_critic())
    rng = np.random.default_rng(seed)
    folds = roll_out(
        policy, engine, strip, [describe(strip)], settings=Rollout(sensing=IMAGES), rng=rng
    )
    touch = folds.touch[0]
    if touch is None:
        return np.nan, np.nan, policy
    here, before = engine.poses[-1], engine.poses[-2]
    steps = np.arange(1, round(SEEN_AFTER / DT) + 1)[:, None]
    on = here + steps * DT * (here - before) / engine.dt
    engine.along(on)
    end = np.array([touch.x - touch.to_grasped, max(strip.thickness, 0.001), np.pi])
    count = int(np.hypot(*(end - on[-1])[:2]) / SPEED / DT)
    share = np.linspace(0.0, 1.0, count + 1)[1:, None]
    engine.along(on[-1] + share * (end - on[-1]))
    engine.along(np.tile(end, (round(0.2 / DT), 1)))
    engine.chain.release()
    engine.along(np.tile(end, (round(0.8 / DT), 1)))
    return touch.displacement, -float(engine.shapes()[0, -1, 0]), policy


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    rng = np.random.default_rng(1)
    rows, terms = [], []
    for seed in range(count):
        hidden = {"bending_hysteresis": friction(rng, 5.0, 60.0)} if rng.uniform() < 0.5 else {}
        strip = plain(rng, **hidden)
        d, offset, _ = laid(strip, seed)
        rubbing = strip.effects.get("bending_hysteresis", {}).get("yield_curvature", 0.0)
        c, tau = strip.bending_length, strip.retardation_time
        print(
            f"c {1e3 * c:5.1f} mm  tau {1e3 * tau:5.0f} ms  friction {rubbing:5.1f} 1/m  "
            f"d {1e3 * d:+5.1f}  offset {1e3 * offset:+5.1f} mm",
            flush=True,
        )
        rows.append((d, offset))
        terms.append((1.0, np.log(c / 0.02), np.log(tau / 0.05), np.log1p(rubbing / 10.0)))
    d, offset = np.array(rows).T
    known = np.isfinite(offset)
    fit = np.linalg.lstsq(np.array(terms)[known], (offset - d)[known], rcond=None)[0]
    left = (offset - d)[known] - np.array(terms)[known] @ fit
    for name, value in (("|d|", np.abs(d[known])), ("|offset|", np.abs(offset[known]))):
        most, worst = 1e3 * np.quantile(value, 0.95), 1e3 * value.max()
        print(f"{name:9s} mean {1e3 * value.mean():.2f}, 95 % {most:.2f}, worst {worst:.2f} mm")
    print("fit", np.round(1e3 * fit, 2), f"mm, rms {1e3 * left.std():.2f} mm, {known.sum()} folds")


if __name__ == "__main__":
    main()
