"""What the model predicts of measured folds: white at the truth, and telling away from it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip import subject
from cell.gap.subject.strip.subject import Strip, open_strip
from cell.gap.subject.strip.synthetic import reported_path, rod_folds
from cell.gap.subject.subject import Request, Run
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.rod.motions import GripperPath
from drivers.types import Array
from policies.experiments.motion import motion
from policies.experiments.standard import WHOLE
from policies.path import triangular
from tests.support.gap_strip_cases import (
    CELL,
    STRIP,
    denim,
    folds,
    in_noise,
    residuals,
    whitened,
    written,
)

SLACK = 0.0003  # m, about as much as a gripper leaves
Effects = Mapping[str, Array]
NAMES = ("there-and-back", "fast", "early-shake", "taut-lift")
HIDDEN: dict[str, tuple[float, ...]] = {
    "bending_hysteresis": (8.0, 8.0, 0.5, 0.4),
    "nonlinear_bending": (1e-4, 1.0),
    "camera_latency": (0.02,),
    "desk_tilt": (0.01,),
}
SILENT = {"layer_adhesion", "pre_curl"}
"""No fold that ends at the touch, with both ends clamped, can show these."""


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Strip:
    root = tmp_path_factory.mktemp("plain") / "runs"
    written(root, folds(NAMES))
    return open_strip(STRIP, find_runs([root]))


@pytest.fixture(scope="module", params=HIDDEN)
def hidden(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Strip, dict[str, Array]]:
    """Folds with an effect hidden in them, and the effect."""
    name, numbers = request.param, HIDDEN[request.param]
    root = tmp_path_factory.mktemp("hidden") / "runs"
    keys = [p.name for p in registry()[name].parameters]
    written(root, folds(NAMES, {name: dict(zip(keys, numbers, strict=True))}))
    return open_strip(STRIP, find_runs([root])), {name: np.array(numbers)}


def square(strip: Strip, effects: dict[str, Array]) -> float:
    return float(np.mean(whitened(strip, residuals(strip, effects)) ** 2))


def test_nothing_hidden_leaves_noise(plain: Strip) -> None:
    found = residuals(plain)
    assert 0.8 < in_noise(plain, found, "profile") < 1.45
    assert 0.8 < in_noise(plain, found, "contact_x") < 1.3
    assert in_noise(plain, found, "layer_touch") < 2.0


def test_what_nothing_hidden_leaves_is_white(plain: Strip) -> None:
    products, squares = 0.0, 0.0
    for run, r in zip(plain.runs, residuals(plain), strict=True):
        x = r.mean / run.samples.noise
        for series in np.unique(run.samples.series):
            row = x[run.samples.series == series]
            products += float(row[:-1] @ row[1:])
            squares += float(row @ row)
    assert abs(products / squares) < 0.3


def test_a_hidden_effect_shows_and_its_truth_leaves_noise(
    hidden: tuple[Strip, dict[str, Array]],
) -> None:
    strip, truth = hidden
    found = residuals(strip, truth)
    assert in_noise(strip, found, "profile") < 1.6
    assert in_noise(strip, found, "contact_x") < 1.4
    assert square(strip, {}) > 2.0 * square(strip, truth)


@pytest.mark.slow
def test_every_effect_that_folds_can_show_shows(plain: Strip) -> None:
    stated = whitened(plain, residuals(plain))
    silent = set()
    for candidate in plain.scope.candidates:
        groups = candidate.probes[-len(candidate.probes) // 2 :]
        largest = [np.array(vector) for group in groups for vector in group]
        shifts = [whitened(plain, residuals(plain, {candidate.name: v})) for v in largest]
        if all(np.nanmax(np.abs(s - stated)) < 0.5 for s in shifts):
            silent.add(candidate.name)
    assert silent == SILENT


def test_a_law_bends_by_numbers_that_come_last(plain: Strip) -> None:
    seam = next(c for c in plain.scope.candidates if c.name == "seam")
    bent = seam.with_shape()
    assert [p.name for p in bent.parameters] == ["factor", "position", "width", "softness"]
    vector = np.array([5.0, 0.3, 0.06])
    stated, soft = bent.complete(vector), np.array([*vector, 0.4])
    straight = whitened(plain, residuals(plain, {"seam": vector}))
    same, changed = (whitened(plain, residuals(plain, {"seam": v})) for v in (stated, soft))
    np.testing.assert_array_equal(same, straight)
    assert np.nanmax(np.abs(changed - straight)) > 1.0


def test_every_term_shows_and_vanishes_with_its_amount(plain: Strip) -> None:
    stated = whitened(plain, residuals(plain))
    for term in plain.scope.terms:
        null = whitened(plain, residuals(plain, {term.name: np.zeros(1)}))
        np.testing.assert_array_equal(null, stated)
        moved = whitened(plain, residuals(plain, {term.name: np.array(term.probes[0][0])}))
        assert np.abs(moved - stated).max() > 1e-3


def test_a_prediction_does_not_depend_on_company_threads_or_portions(
    plain: Strip, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = np.array([p.start for p in plain.scope.base])
    asked = [
        Request(run, base * factor, {}, np.zeros(len(run.local)))
        for factor in (1.0, 1.05, 0.97)
        for run in plain.runs
    ]
    together = plain.simulate(asked)
    plain._simulation._known.clear()
    alone = [plain.simulate([one])[0] for one in asked]
    plain._simulation._known.clear()
    monkeypatch.setattr(plain._simulation, "_jobs", 2)
    monkeypatch.setattr(subject, "PORTION", 5)
    threaded = plain.simulate(asked[::-1])[::-1]
    for a, b, c in zip(together, alone, threaded, strict=True):
        np.testing.assert_array_equal(a.mean, b.mean)
        np.testing.assert_array_equal(a.mean, c.mean)


def test_slack_of_a_run_is_like_so_much_more_strip(plain: Strip) -> None:
    stated = whitened(plain, residuals(plain))
    slack = whitened(plain, residuals(plain, slack=-2 * SLACK)) - stated
    longer = whitened(plain, residuals(plain, {"length_error": np.array([-2 * SLACK])})) - stated
    assert np.linalg.norm(slack - longer) < 0.2 * np.linalg.norm(longer)


def test_phases_and_zones_name_the_stages_of_a_fold(plain: Strip) -> None:
    words = {run.name[3:]: set(run.samples.phase) for run in plain.runs}
    assert words["there-and-back"] >= {"carry", "return", "fall", "touch"}
    assert words["early-shake"] >= {"hold", "carry", "fall"}
    assert words["taut-lift"] == {"carry", "hold", "return"}
    assert {z for run in plain.runs for z in run.samples.zone} == {"middle", "grasped"}


def test_wild_points_and_lost_images_do_no_harm(tmp_path: Path) -> None:
    made = folds(["fast", "taut-lift"])
    written(tmp_path / "wild", made, replace(CELL, wild=0.08, lost=0.4))
    strip = open_strip(STRIP, find_runs([tmp_path / "wild"]))
    assert in_noise(strip, residuals(strip), "profile") < 1.5


def test_a_strip_that_hangs_at_the_start_is_predicted_too(tmp_path: Path) -> None:
    t = np.arange(0.0, 3.0, 0.01)
    share = np.clip(t / 2.5, 0.0, 1.0)
    share = share * share * (3 - 2 * share)
    poses = np.column_stack([0.5 - 0.2 * share, 0.10 + 0.2 * share, np.full(len(t), np.pi / 2)])
    paths = [GripperPath(t, poses, hanging=True)] * 2
    made = rod_folds([describe(denim())] * 2, paths, segments=150, dt=0.004)
    written(tmp_path / "runs", [replace(f, index=i, condition="c") for i, f in enumerate(made)])
    strip = open_strip(STRIP, find_runs([tmp_path / "runs"]))
    assert in_noise(strip, residuals(strip), "profile") < 1.5
    assert in_noise(strip, residuals(strip), "contact_x") < 1.4


def in_profile(strip: Strip, runs: Sequence[Run], effects: Sequence[Effects]) -> float:
    """By how much [m] the profiles of two models differ, root mean square."""
    base = np.array([p.start for p in strip.scope.base])
    found = strip.simulate(
        [Request(r, base, e, np.zeros(len(r.local))) for e in effects for r in runs]
    )
    parts = [
        (b.mean - a.mean)[run.samples.channel == "profile"]
        for run, a, b in zip(runs, found, found[len(runs) :], strict=False)
    ]
    return float(np.sqrt(np.nanmean(np.concatenate(parts) ** 2)))


def test_strip_with_hysteresis_is_simulated_without_the_buckle_of_a_push(tmp_path: Path) -> None:
    path = reported_path(motion(triangular(0.6), WHOLE, 0.1))
    (made,) = rod_folds([describe(denim())], [path], segments=150, dt=0.004)
    written(tmp_path / "runs", [replace(made, condition="triangular", index=i) for i in range(2)])
    strip = open_strip(STRIP, find_runs([tmp_path / "runs"]))
    yarns = {"bending_hysteresis": np.array([48.0, 8.0])}
    rubbed = [yarns, yarns | {"crease": np.array([0.03, 0.57])}]
    pushed = [
        replace(r, content=replace(r.content, lifted_path=r.content.path)) for r in strip.runs
    ]
    assert in_profile(strip, pushed, rubbed) > 4 * in_profile(strip, strip.runs, rubbed)


def test_what_sits_at_the_end_of_a_strip_that_turns_out_shorter_is_tried_there(
    plain: Strip,
) -> None:
    shorter = {"length_error": np.array([-0.002])}
    at_end = residuals(plain, shorter | {"crease": np.array([0.3, 0.598])})
    beyond = residuals(plain, shorter | {"crease": np.array([0.3, 0.6])})
    for a, b in zip(at_end, beyond, strict=True):
        np.testing.assert_array_equal(a.mean, b.mean)
