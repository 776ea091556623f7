"""Runs along one path share the simulations of rough responses."""

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.prepare import Fold
from cell.gap.subject.strip.simulation import HashedModel, Simulation
from cell.gap.subject.strip.subject import Strip, open_strip
from cell.gap.subject.subject import Request
from drivers.strip.describe import describe
from drivers.types import Array
from tests.support.gap_strip_cases import STRIP, folds, written

NAMES = ("normal", "fast", "normal")
YARNS = {"bending_hysteresis": np.array([8.0, 8.0, 0.5, 0.4])}


@pytest.fixture(scope="module")
def strip(tmp_path_factory: pytest.TempPathFactory) -> Strip:
    root: Path = tmp_path_factory.mktemp("replicates") / "runs"
    written(root, folds(NAMES))
    return open_strip(STRIP, find_runs([root]))


def responses(strip: Strip, *, rough: bool) -> list[Array]:
    """What friction between yarns changes in each run, in noise and floors."""
    base = np.array([p.start for p in strip.scope.base])
    asked = [
        Request(run, base, effects, np.zeros(len(run.local)), rough)
        for effects in ({}, YARNS)
        for run in strip.runs
    ]
    found = strip.simulate(asked)
    count = len(strip.runs)
    return [
        (there.mean - here.mean) / np.hypot(run.samples.noise, run.samples.floor)
        for here, there, run in zip(found[:count], found[count:], strip.runs, strict=True)
    ]


def test_runs_of_one_name_and_path_are_compared_each_with_its_own_measurement(
    strip: Strip,
) -> None:
    known = strip.runs[0]
    comparison = cast(Fold, known.content).comparison
    moved = replace(comparison.run, contact_x=comparison.run.contact_x + 0.001)
    fold = replace(cast(Fold, known.content), comparison=replace(comparison, run=moved))
    base = np.array([p.start for p in strip.scope.base])
    runs = (known, replace(known, content=fold))
    asked = [Request(run, base, {}, np.zeros(len(run.local))) for run in runs]
    here, there = (strip.simulate([request])[0] for request in asked)
    seen = known.samples.channel == "contact_x"
    np.testing.assert_allclose((there.mean - here.mean)[seen], 0.001, atol=1e-9)


def test_a_contact_seen_at_a_hump_belongs_to_the_hump_if_the_strip_has_one(strip: Strip) -> None:
    fold = cast(Fold, strip.runs[0].content)
    model = describe(strip.file)
    (flat,) = Simulation()([fold.drive(HashedModel.of(model))])
    assert flat is not None
    run, place = fold.comparison.run, float(flat.arc[40]) * strip.file.length
    shapes = flat.shapes.copy()
    shapes[:, 41:43, 1] = np.maximum(shapes[:, 41:43, 1], 2.0 * run.contact_height)
    humped = replace(flat, shapes=shapes)
    moved = replace(run, contact_x=np.where(run.contact_x > place + 0.1, place, run.contact_x))
    contacts = fold.comparison.layout.samples.channel == "contact_x"
    right, wrong = fold.comparison, replace(fold.comparison, run=moved)
    plain, lost, found = (
        comparison(model, shown).mean[contacts]
        for comparison, shown in ((right, humped), (wrong, flat), (wrong, humped))
    )
    np.testing.assert_array_equal(plain, right(model, flat).mean[contacts])
    assert np.isnan(lost).sum() > 3
    assert np.abs(found).max() < 0.01
