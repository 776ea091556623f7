"""What the engines cost and how exact they are, on the same folds, in one run.

python -m tests.benchmarks.bench_engines [--quick] [--without-paper]

Folds: {softest, middling, stiffest} x {least, middling, most damping of the paper's range} x
{triangular, circular} at 0.1 m/s. Costs are of processor time, so that other programs disturb
them little; only the last table, threads, needs an idle machine. Errors are of d against the rod
converged in segments and step. With the extra `bench`, PyElastica's cost is shown too.
"""

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from drivers.errors import SimulationNotFinite
from drivers.strip.engine import Stepper, simulate
from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from drivers.types import Array
from policies.path import Path, circular, triangular
from tests.benchmarks.elastica_cost import ELEMENTS, cost_and_step
from tests.benchmarks.paper_formulation import PaperFormulation
from tests.support.rod_cases import paper_model, steady

DT = 0.005
STIFFNESS = (0.02, 0.0775, 0.3)
DAMPING = (1.0, 7.0, 50.0)
REFERENCE = (400, 0.00125)  # segments, step [s]
REPEATS = 3
COPIES = 8  # of all folds side by side, in the batches


@dataclass(frozen=True)
class Fold:
    model: StripModel
    path: Path

    def poses(self, dt: float) -> Array:
        return steady(self.path, dt)


@dataclass(frozen=True)
class Measured:
    """Displacements (n,) [m] and simulated spans (n,) [s] until the touch; cost [s]."""

    d: Array
    spans: Array
    cost: float

    @property
    def per_second(self) -> float:
        """Milliseconds of one core per simulated second of a strip."""
        return 1e3 * self.cost / float(np.nansum(self.spans))


def folds(*, quick: bool) -> list[Fold]:
    damping = DAMPING[::2] if quick else DAMPING
    stiffness = STIFFNESS[::2] if quick else STIFFNESS
    paths = (triangular(0.6), circular(0.6))
    return [Fold(paper_model(k, b), path) for path in paths for k in stiffness for b in damping]


def together(rod: Rod, wanted: Sequence[Fold], dt: float = DT) -> Measured:
    """All folds in one batch, in one call."""
    poses = [fold.poses(dt) for fold in wanted]
    last = max(map(len, poses))
    batch = np.stack([np.pad(p, ((0, last - len(p)), (0, 0)), "edge") for p in poses], axis=1)
    rod.reset([fold.model for fold in wanted])
    begun = time.thread_time()
    touch = rod.advance(batch, dt).touch
    cost = time.thread_time() - begun
    d = np.array([t.displacement if t else np.nan for t in touch])
    return Measured(d, np.array([t.time if t else last * dt for t in touch]), cost)


def one_by_one(engine: Stepper, wanted: Iterable[Fold]) -> Measured:
    """Fold after fold, step after step, as a fold on the twin does it."""
    rows = []
    begun = time.thread_time()
    for fold in wanted:
        poses = fold.poses(DT)
        t = DT * np.arange(len(poses) + 1)
        start = np.array([[fold.path.points[0, 0], 0.0, 0.0]])
        try:
            motion = simulate(engine, fold.model, t, np.concatenate([start, poses]), dt=DT)
        except SimulationNotFinite:
            rows.append((np.nan, np.nan))
            continue
        touch = motion.touch
        rows.append((touch.displacement if touch else np.nan, motion.t[-1]))
    return Measured(*np.array(rows).T, time.thread_time() - begun)


def alone(rod: Rod, wanted: Sequence[Fold]) -> Measured:
    """Each fold a batch of its own."""
    each = [together(rod, [fold]) for fold in wanted]
    d, spans = (np.concatenate([getattr(m, name) for m in each]) for name in ("d", "spans"))
    return Measured(d, spans, sum(m.cost for m in each))


def best(measure: Callable[[], Measured], repeats: int = REPEATS) -> Measured:
    """The cheapest of a few; the results are the same in all."""
    return min((measure() for _ in range(repeats)), key=lambda m: m.cost)


def row(name: str, found: Measured, reference: Array | None = None) -> None:
    text = f"{name:42s} {found.per_second:9.2f} ms/s {1e3 / found.per_second:9.0f} s/s "
    text += f"{1e3 * found.cost / len(found.d):9.2f} ms a fold"
    if reference is not None:
        error = 1e3 * np.abs(found.d - reference)
        missing = int(np.sum(~np.isfinite(error)))
        error = error[np.isfinite(error)]
        text += f"   error {error.mean():6.2f} mean {error.max():6.2f} worst mm"
        text += f"  ({missing} of {len(found.d)} not finite)" if missing else ""
    print(text, flush=True)


def formulations(wanted: Sequence[Fold], *, paper: bool) -> None:
    print(f"{len(wanted)} folds; ms of one core per simulated second, simulated seconds per second")
    truth = together(Rod(REFERENCE[0]), wanted, REFERENCE[1]).d
    check = together(Rod(REFERENCE[0] // 2), wanted, 2 * REFERENCE[1]).d
    print(f"reference: rod, {REFERENCE[0]} segments, {1e3 * REFERENCE[1]:g} ms; at half of both "
          f"within {1e3 * np.abs(check - truth).max():.2f} mm")  # fmt: skip
    many = [*wanted] * COPIES
    batch = best(lambda: together(Rod(100), many))
    row(f"rod, 100 segments, {len(many)} folds side by side", batch, np.tile(truth, COPIES))
    row("rod, 100 segments, each fold alone", best(lambda: alone(Rod(100), wanted)), truth)
    chains = {}
    for links in (60, 100, 200):
        chains[links] = one_by_one(Chain(links), wanted)
        row(f"chain, {links} links", chains[links], truth)
    print(f"  batches of the rod against the 100-link chain: "
          f"{chains[100].per_second / batch.per_second:.0f} times")  # fmt: skip
    if paper:
        theirs = one_by_one(PaperFormulation(), wanted)
        row("the paper's: 300 links, 5 ms, Euler, soft weld", theirs, truth)
        print(f"  batches of the rod against the paper's formulation: "
              f"{theirs.per_second / batch.per_second:.0f} times")  # fmt: skip


def elastica() -> None:
    middling = paper_model(STIFFNESS[1]).mechanics
    try:
        cost, step = cost_and_step(middling.rigidity[0], middling.linear_density[0])
    except ImportError:
        print("PyElastica: not installed, left out; the extra `bench` brings it")
        return
    name = f"PyElastica, {ELEMENTS} elements, cost alone"
    print(f"{name:42s} {1e3 * cost:9.2f} ms/s {1 / cost:9.1f} s/s   "
          f"longest step that holds {1e6 * step:.0f} us")  # fmt: skip


def growth(wanted: Sequence[Fold]) -> None:
    print("\ngrowth with elements: ms of one core per simulated second")
    counts = (50, 100, 200, 400)
    found = [best(lambda n=n: together(Rod(n), wanted), 2).per_second for n in counts]
    print("  rod    " + "".join(f"{n:6d}: {ms:6.2f}" for n, ms in zip(counts, found, strict=True)))
    links = (30, 60, 120)
    few = wanted[:: max(len(wanted) // 4, 1)]
    found = [one_by_one(Chain(n), few).per_second for n in links]
    print("  chain  " + "".join(f"{n:6d}: {ms:6.2f}" for n, ms in zip(links, found, strict=True)))
    print("growth with folds side by side: ms of one core per simulated second of a strip")
    sizes = (1, 2, 4, 8, 16, 64, 256)
    many = [wanted[i % len(wanted)] for i in range(max(sizes))]
    found = [best(lambda n=n: together(Rod(100), many[:n])).per_second for n in sizes]
    print("  rod    " + "".join(f"{n:6d}: {ms:6.2f}" for n, ms in zip(sizes, found, strict=True)))


def threads(wanted: Sequence[Fold]) -> None:
    """Folds a second of wall time, each thread with a batch of its own."""
    many = [*wanted] * COPIES
    print(f"\ngrowth with threads: {len(many)} folds a thread, folds a second of wall time")
    rates = {}
    for count in (1, 2):
        with ThreadPoolExecutor(count) as pool:
            begun = time.perf_counter()
            list(pool.map(lambda _: together(Rod(100), many), range(count)))
            rates[count] = count * len(many) / (time.perf_counter() - begun)
        print(
            f"  rod    {count} threads: {rates[count]:7.0f}  ({rates[count] / rates[1]:.2f} times)"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="corners of the range alone")
    parser.add_argument("--without-paper", action="store_true", help="it takes minutes")
    asked = parser.parse_args()
    wanted = folds(quick=asked.quick)
    together(Rod(40), wanted[:1])  # loads the compiled code
    formulations(wanted, paper=not asked.without_paper)
    elastica()
    growth(wanted)
    threads(wanted)


if __name__ == "__main__":
    main()
