"""How far folds roll on after the touch, on the chain: python -m tests.benchmarks.measure_roll [N].

Folds N strips drawn at random by `adaptive` from noisy states, lays each down twice, lets go, and
prints d and the final offsets of the edges: of a lay that ends short, from which the edge springs
to where the fold rolled, and of the cell's lay, which ends at the fixed edge. In the end the fits
of `policies.adaptive.roll` and of `calibration.perception.laid`.
"""

import sys
from collections.abc import Sequence

import numpy as np

from calibration.perception.measurement import SeenTouch
from cell.orchestrator.lay import BRAKING, CREEP, HANGING, TURNING, lay_path
from drivers.strip.describe import describe
from drivers.strip.engine import Observables
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.shape import Touch
from drivers.twin.chain.engine import Chain
from drivers.types import Array, Pose
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.bias import Bias
from policies.adaptive.checkpoint import load_critic
from policies.adaptive.fabrics import friction, plain
from policies.adaptive.roll import terms
from policies.path import Path
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGES

LINKS = 80
DT = 0.005  # s
SEEN_AFTER = 0.1  # s after the touch, when it is told
SPEED = 0.1  # m/s
SHORT = 0.006  # m before the taut edge
ON_CHAIN = Bias(0.77e-3)  # of the critic, told of states


class Traced:
    """A chain that remembers where its gripper went."""

    def __init__(self) -> None:
        self.chain = Chain(LINKS)
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


def folded(strip: StripFile, seed: int) -> tuple[Touch | None, Array, float]:
    """The touch of one fold, the poses (k, 3) that led there, and their step [s]."""
    engine, policy = Traced(), Adaptive(load_critic(), ON_CHAIN)
    rng = np.random.default_rng(seed)
    folds = roll_out(
        policy, engine, strip, [describe(strip)], settings=Rollout(sensing=IMAGES), rng=rng
    )
    return folds.touch[0], np.array(engine.poses), engine.dt


def lay_poses(path: Path) -> Array:
    """Poses (k, 3) of the cell's lay along `path`, `DT` apart."""
    speed, progress, poses = min(SPEED, TURNING * path.length / HANGING), 0.0, []
    while progress < path.length:
        pace = min(speed, max(CREEP, float(np.sqrt(2 * BRAKING * (path.length - progress)))))
        progress = min(progress + pace * DT, path.length)
        poses.append([*path.at(progress), HANGING * (1 + progress / path.length)])
    return np.array(poses)


def laid(
    strip: StripFile, poses: Array, dt: float, end: tuple[float, float] | None, touch: Touch
) -> tuple[float, float, float]:
    """Final offset of the edges, x of the loop's end and its height [m] after a lay to `end`, or
    the cell's.
    """
    chain = Chain(LINKS)
    chain.reset([describe(strip)])
    for pose in poses:
        chain.step(pose[None], dt)
    velocity = (poses[-1] - poses[-2]) / dt
    steps = np.arange(1, round(SEEN_AFTER / DT) + 1)[:, None]
    on = poses[-1] + steps * DT * velocity
    seen = SeenTouch(touch.time, touch.x, touch.to_grasped, touch.to_fixed, 1.0, strip.thickness)
    path = lay_path(seen, Pose(*on[-1]), max(strip.thickness, 0.001))
    if end is not None:
        path = Path.through(np.array([path.points[0], end]))
    down = lay_poses(path)
    still = np.tile(down[-1], (round(0.2 / DT), 1))
    for pose in (*on, *down, *still):
        chain.step(pose[None], DT)
    chain.release()
    for _ in range(round(0.8 / DT)):
        chain.step(down[-1][None], DT)
    shape = chain.shapes()[0]
    return -float(shape[-1, 0]), float(shape[:, 0].max()), float(shape[:, 1].max())


def one(strip: StripFile, seed: int) -> tuple[float, float, float, float, float] | None:
    """d, offset after the short lay; offset after the cell's, x of the loop's end and its height
    then [m].
    """
    touch, poses, dt = folded(strip, seed)
    if touch is None:
        return None
    rest = max(strip.thickness, 0.001)
    short = laid(strip, poses, dt, (SHORT - touch.displacement, rest), touch)[0]
    return (touch.displacement, short, *laid(strip, poses, dt, None, touch))


def fit(name: str, terms: Array, values: Array) -> None:
    """Print a robust least-squares fit of `values` (n,) [m] by `terms` (n, k)."""
    weight = np.ones(len(values))
    for _ in range(6):
        found = np.linalg.lstsq(terms * weight[:, None], values * weight, rcond=None)[0]
        off = values - terms @ found
        weight = 1.0 / np.sqrt(1.0 + (off / 1.5e-3) ** 2)
    print(f"{name}: {np.round(1e3 * found, 2)} mm, rms {1e3 * off.std():.2f} mm")


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    rng = np.random.default_rng(1)
    rows, strips = [], []
    for seed in range(count):
        rough = rng.uniform() < 0.5
        strip = plain(rng, bending_hysteresis=friction(rng, 5.0, 60.0)) if rough else plain(rng)
        found = one(strip, seed)
        if found is None:
            continue
        rubbing = strip.effects.get("bending_hysteresis", {}).get("yield_curvature", 0.0)
        d, short, offset, tip, height = found
        print(
            f"c {1e3 * strip.bending_length:5.1f} mm  tau {1e3 * strip.retardation_time:5.0f} ms  "
            f"friction {rubbing:5.1f} 1/m  d {1e3 * d:+5.1f}  short {1e3 * short:+5.1f}  "
            f"offset {1e3 * offset:+5.1f} mm",
            flush=True,
        )
        rows.append((d, short, offset, strip.length - 2 * tip, height, strip.thickness))
        strips.append((strip.bending_length, strip.retardation_time, np.log1p(rubbing / 10.0)))
    d, short, offset, straight, height, thickness = np.array(rows).T
    c, tau, rubbed = np.array(strips).T
    for name, value in (("|d|", np.abs(d)), ("|offset|", np.abs(offset))):
        most, worst = 1e3 * np.quantile(value, 0.95), 1e3 * value.max()
        print(f"{name:9s} mean {1e3 * value.mean():.2f}, 95 % {most:.2f}, worst {worst:.2f} mm")
    fit("roll (`terms`)", terms(np.log(c), np.log(tau), rubbed), short - d)
    loop = np.stack([np.ones(len(c)), height, thickness], axis=1)
    fit("loop (1, height, thickness)", loop, offset - straight)


if __name__ == "__main__":
    main()
