"""Cost and error of the rod: `python -m tests.benchmarks.bench_rod`.

Costs in milliseconds of one core per simulated second and strip, over folds of the paper's range
until their layers touch; errors in the displacement against 400 segments of 1 ms.
"""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from drivers.strip.model import StripModel
from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.path import Path, circular, triangular
from tests.support.rod_cases import for_all, paper_grid, steady

PATHS = {"triangular": triangular(0.6), "circular": circular(0.6)}
SIZES = ((60, 0.010), (60, 0.005), (100, 0.005), (200, 0.005), (300, 0.005))


def main() -> None:
    """Print errors and costs by elements and step, by the number of folds, and by threads."""
    start = time.perf_counter()
    models = paper_grid()
    for count in (1, 2):
        _fold(models[:count], PATHS["triangular"], 100, 0.005)
    print(f"first folds, compiled or read back: {time.perf_counter() - start:.1f} s")
    print("segments   step    alone  in batch   error in d [mm], mean / worst")
    exact = {name: _fold(models, path, 400, 0.001)[0] for name, path in PATHS.items()}
    for segments, dt in SIZES:
        _line(models, segments, dt, exact)
    for folds in (1, 8, 64, 512):
        many = (models * 21)[:folds]
        cost = min(_fold(many, PATHS["triangular"], 100, 0.005)[1] for _ in range(3))
        print(f"{folds:5d} folds {cost:8.3f} ms")
    _threads((models * 5)[:104])


def _fold(models: list[StripModel], path: Path, segments: int, dt: float) -> tuple[Array, float]:
    """Displacements (n,) [m], and the cost."""
    rod = Rod(segments)
    rod.reset(models)
    poses = for_all(steady(path, dt), len(models))
    start = time.thread_time()
    rod.advance(poses, dt)
    spent = time.thread_time() - start
    touches = [touch for touch in rod.touch if touch]
    return np.array([t.displacement for t in touches]), 1e3 * spent / sum(t.time for t in touches)


def _line(models: list[StripModel], segments: int, dt: float, exact: dict[str, Array]) -> None:
    errors, batch, alone = [], [], []
    for name, path in PATHS.items():
        displacement, cost = _fold(models, path, segments, dt)
        errors.append(1e3 * np.abs(displacement - exact[name]))
        batch.append(cost)
        alone.append(_fold(models[12:13], path, segments, dt)[1])
    error = np.concatenate(errors)
    print(
        f"{segments:8d} {1e3 * dt:3.0f} ms {np.mean(alone):8.3f} {np.mean(batch):9.3f}"
        f"   {error.mean():.2f} / {error.max():.2f}"
    )


def _threads(models: list[StripModel]) -> None:
    rates = []
    for threads in (1, 2):
        with ThreadPoolExecutor(threads) as pool:
            start = time.perf_counter()
            work = [
                pool.submit(_fold, models, PATHS["triangular"], 100, 0.005)
                for _ in range(2 * threads)
            ]
            folds = sum(len(job.result()[0]) for job in work)
            rates.append(folds / (time.perf_counter() - start))
    print(f"folds per second, 1 and 2 threads: {rates[0]:.0f}, {rates[1]:.0f}")


if __name__ == "__main__":
    main()
