"""Synthetic results of folds and benchmarks."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.base.config.places import find_configs
from cell.folding import batch
from cell.folding.result import FoldResult
from cell.studies.results import BenchmarkSpec, ImageFold, RangeFolds, Results

DONE = FoldResult(
    run="runs/one",
    strip="denim",
    policy="triangular",
    seed=0,
    outcome="layer_touch",
    reason="the layers touch",
    displacement=-0.0337654321,
    displacement_true=None,
    layer_touch=5.46789,
    edge_offset=-0.03,
    edge_offset_true=None,
    duration=16.76,
    wall=8.1,
    calibration="0123456789ab",
    exit_code=0,
)
STOPPED = replace(
    DONE, outcome="interrupted", displacement=None, layer_touch=None, exit_code=130
)


def fold_by(
    monkeypatch: pytest.MonkeyPatch, fold: Callable, **others: Callable
) -> None:
    """Replace the fold of batches by `fold`, without calibration."""
    plain = {"calibration_of": lambda *_: None}
    for name, function in ({"fold": fold} | plain | others).items():
        monkeypatch.setattr(batch, name, function)


CONFIGS = find_configs(Path(__file__).parents[2] / "configs")
POLICIES = ("triangular", "circular", "shifted", "planned", "feedback")
STRIPS = ("blanket", "denim", "rib-knit")
USUAL = {"triangular": -0.040, "circular": 0.060, "shifted": 0.005, "planned": -0.001}
USUAL |= {"feedback": 0.004}


def asked(*policies: str, strips: tuple[str, ...] = ()) -> BenchmarkSpec:
    return BenchmarkSpec.build(CONFIGS, policies, strips, None, 0, quick=True)


def image_fold(policy: str, strip: str, d: float | None, seed: int = 0) -> ImageFold:
    return ImageFold(
        strip=strip,
        bending_length=0.01 + 0.002 * STRIPS.index(strip),
        retardation_time=0.05,
        policy=policy,
        seed=seed,
        outcome="path_done" if d is None else "layer_touch",
        reason="",
        displacement=d,
        displacement_true=d,
        duration=14.0,
        wall=7.0,
        run="nowhere",
    )


def measured(**changed: float | None) -> Results:
    """Complete benchmark result; `changed` are displacements [m] by feedback per
    strip.
    """
    rng = np.random.default_rng(0)
    folds = [
        image_fold(p, s, changed.get(s, USUAL[p]) if p == "feedback" else USUAL[p])
        for p in POLICIES
        for s in STRIPS
    ]
    folds += [image_fold(p, "denim", USUAL[p] + 2e-4, seed=1) for p in POLICIES]
    over = [
        RangeFolds(
            policy=p,
            engine=engine,
            side=4,
            displacement=(None, *(USUAL[p] + 0.004 * rng.normal(size=15)).tolist()),
            force=tuple(rng.uniform(0.1, 0.4, size=16).tolist()),
        )
        for p in POLICIES
        for engine in ("rod", "chain")
    ]
    return Results(
        schema=1,
        asked=asked(*POLICIES),
        made_with={"cell": "twin-cell"},
        speed=0.1,
        results=(*folds, *over),
    )
