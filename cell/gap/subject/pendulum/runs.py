"""Measured swings: read, checked, and cut into the samples that the engine compares."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.blocks import blocks
from cell.gap.subject.pendulum.chain import base_values, fastest, swings
from cell.gap.subject.pendulum.file import PendulumFile
from cell.gap.subject.run_folders import check_schema, check_time, column, index_of, read_table
from cell.gap.subject.subject import Parameter, Run, Samples
from drivers.errors import ConfigurationError
from drivers.settings import read_yaml
from drivers.types import Array, frozen

ANGLE_FLOOR = 5e-5  # rad, of the integration and of the shape of a smoothed friction
BLOCK = 0.8  # rad of the fastest small swing in one sample
FASTEST_SWING = 200.0  # rad/s that no free swing reaches


@dataclass(frozen=True, slots=True)
class Swing:
    """Readings of a run: `t` (m,) from 0 [s], `angles` (n, m) [rad], `edges` (k + 1,) of samples.

    `initial` (2, n): angles [rad] and rates [rad/s] to start from.
    """

    t: Array
    angles: Array
    edges: NDArray[np.int64]
    initial: Array


def read_run(folder: Path, name: str, pendulum: PendulumFile) -> Run:
    """The run in `folder`; raises ConfigurationError, in one line, for anything broken."""
    head = read_yaml(folder / "run.yaml")
    sigma = _head(head, folder / "run.yaml", pendulum)
    path = folder / "angles.parquet"
    table = read_table(path)
    n = len(pendulum.links)
    t = column(table, "t", path)
    check_time(t, path, least=30)
    angles = np.stack([column(table, f"theta_{i + 1}", path) for i in range(n)])
    if f"theta_{n + 1}" in table:
        raise ConfigurationError(f"{path}: theta_{n + 1}: {pendulum.name} has {n} links only")
    rates = None
    if all(f"omega_{i + 1}" in table for i in range(n)):
        rates = np.stack([column(table, f"omega_{i + 1}", path) for i in range(n)])
    _check_units(t, angles, rates, path)
    _check_step(t, fastest(pendulum), path)
    condition = str(head.get("condition", name))
    return replace(
        make_run(pendulum, name, condition, t, angles, sigma, rates),
        index=index_of(head, folder / "run.yaml"),
    )


def make_run(
    pendulum: PendulumFile,
    name: str,
    condition: str,
    t: Array,
    angles: Array,
    sigma: float,
    rates: Array | None = None,
) -> Run:
    """A run of readings: times (m,) [s], angles and rates (n, m), noise of a reading [rad]."""
    t = t - t[0]
    fast = fastest(pendulum)
    edges, chosen = blocks(t, BLOCK / fast)
    initial = np.stack([angles[:, 0], _rates(t, angles, rates, 1.0 / fast)])
    swing = Swing(frozen(t[chosen]), frozen(angles[:, chosen]), edges, frozen(initial))
    samples = _samples(pendulum, swing, sigma)
    return Run(name, condition, samples, _local(initial, fast), swing)


def _head(head: dict[str, Any], path: Path, pendulum: PendulumFile) -> float:
    check_schema(head, path)
    stated_name = head.get("pendulum")
    if stated_name is None and "strip" in head:
        raise ConfigurationError(
            f"{path}: pendulum: is missing, this is a run of the strip {head['strip']}; give its "
            "strip file, or runs of the pendulum"
        )
    if stated_name is None:
        raise ConfigurationError(f"{path}: pendulum: is missing; add the pendulum's name")
    if stated_name != pendulum.name:
        raise ConfigurationError(
            f"{path}: pendulum: is {stated_name}, but the file describes {pendulum.name}; give "
            "runs of one pendulum and its file"
        )
    sigma = head.get("sigma")
    angle = sigma.get("angle") if isinstance(sigma, dict) else None
    if isinstance(angle, bool) or not isinstance(angle, int | float):
        raise ConfigurationError(f"{path}: sigma.angle: is missing; add the noise in rad")
    if not 0.0 < angle < 0.3:
        raise ConfigurationError(
            f"{path}: sigma.angle: {angle} is impossible; allowed: above 0, below 0.3 rad"
        )
    return float(angle)


def _check_units(t: Array, angles: Array, rates: Array | None, path: Path) -> None:
    if np.abs(angles).max() > 100.0:
        raise ConfigurationError(
            f"{path}: theta: reaches {np.abs(angles).max():.0f}; angles are in rad from upright"
        )
    slope = np.gradient(angles, t, axis=1)
    speed = float(np.quantile(np.abs(slope), 0.99))
    if speed > FASTEST_SWING:
        raise ConfigurationError(
            f"{path}: t: angles change by {speed:.0f} rad/s, which no free swing does; "
            "t is in s, angles in rad"
        )
    if rates is None or speed < 0.1:
        return
    ratio = float((rates * slope).sum() / (slope * slope).sum())
    if not 0.5 < ratio < 2.0:
        raise ConfigurationError(
            f"{path}: omega: is {ratio:.3g} times the rate of theta; t is in s, angles in rad, "
            "rates in rad/s"
        )


def _check_step(t: Array, fast: float, path: Path) -> None:
    """Refuse readings too far apart to show the fastest small swing, of `fast` [rad/s]."""
    step, longest = float(np.median(np.diff(t))), BLOCK / fast
    if step > longest:
        raise ConfigurationError(
            f"{path}: t: rows are {step:g} s apart, at most {longest:.2g} s shows this pendulum's "
            "swings; t is in s"
        )


def _rates(t: Array, angles: Array, rates: Array | None, span: float) -> Array:
    """Rates at the start (n,): as given, or by a cubic through the first moments."""
    if rates is not None:
        return np.asarray(rates[:, 0])
    near = max(8, int(np.searchsorted(t, span)))
    return np.array([np.polyfit(t[:near], a[:near], 3)[-2] for a in angles])


def _samples(pendulum: PendulumFile, swing: Swing, sigma: float) -> Samples:
    """Samples of all links, link by link."""
    n, k = len(pendulum.links), len(swing.edges) - 1
    counts = np.diff(swing.edges)
    middle = np.add.reduceat(swing.t, swing.edges[:-1]) / counts
    zones = ["fixed"] + ["middle"] * (n - 2) + ["grasped"] * (n > 1)
    return Samples(
        channel=np.full(n * k, "angle"),
        phase=np.tile(_phases(pendulum, swing), n),
        zone=np.repeat(np.array(zones), k),
        quantity=np.full(n * k, "angle"),
        t=np.tile(middle, n),
        noise=np.tile(sigma / np.sqrt(counts), n),
        reading=np.full(n * k, sigma),
        floor=np.full(n * k, ANGLE_FLOOR),
        series=np.repeat(np.arange(n), k),
    )


def _phases(pendulum: PendulumFile, swing: Swing) -> NDArray[np.str_]:
    """`fall` while the pendulum loses height within a sample, else `return` (k,)."""
    chain = swings(pendulum, base_values(pendulum)[None], [{}])
    height = (chain.moment * np.cos(swing.angles)).sum(axis=0)
    last = height[swing.edges[1:] - 1]
    first = height[swing.edges[:-1]]
    return np.where(last < first, "fall", "return")


def _local(initial: Array, fast: float) -> tuple[Parameter, ...]:
    """The initial state of a run: angles, then rates."""
    free = float("inf")
    angles = [
        Parameter(f"angle_{i + 1}", "rad", float(v), -free, free, 1e-5)
        for i, v in enumerate(initial[0])
    ]
    rates = [
        Parameter(f"rate_{i + 1}", "rad/s", float(v), -free, free, 1e-5 * fast)
        for i, v in enumerate(initial[1])
    ]
    return (*angles, *rates)
