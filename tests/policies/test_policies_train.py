"""Training: deterministic, survives kills, and makes the policy better."""

import json
from concurrent.futures import Executor, Future
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from drivers.errors import ConfigurationError
from drivers.strip.file import paper_damping_minimum
from drivers.types import Array
from policies.domain import grid, sample, strip_at
from policies.network import WEIGHT_COUNT, HeadingNetwork
from policies.rollout import Folds
from policies.train.journal import Journal
from policies.train.objective import (
    Scores,
    TrainingSettings,
    evaluate_piece,
    fold_cost,
    misses,
    validate,
)
from policies.train.search import Search, first_weights

SETTINGS = TrainingSettings(generations=12, population=6, validate_every=2)


def bowl(candidates: Array, generation: int) -> Scores:
    """A cost that also depends on the generation, as sampled strips do."""
    wobble = np.random.default_rng(generation).normal() * 1e-3
    miss = np.sum((candidates - 1.0) ** 2, axis=1)
    return Scores(cost=miss + wobble, miss=miss)


def depth(weights: Array) -> float:
    return float(np.sum((weights - 1.0) ** 2))


class Bowl(Executor):
    """Computes the bowl instead of folding; `folded` counts what it was asked for."""

    folded = 0

    def submit(self, compute, settings, *asked):
        self.folded += 1
        job = Future()
        job.set_result({evaluate_piece: bowl, validate: depth}[compute](*asked))
        return job


def train(folder: Path, generations: int, settings: TrainingSettings = SETTINGS) -> Search:
    search = Search(settings, folder)
    run = search.run(Bowl())
    for _ in range(generations):
        if next(run, None) is None:
            break
    return search


def test_run_killed_twice_ends_with_the_weights_of_one_left_alone(tmp_path: Path) -> None:
    alone = train(tmp_path / "alone", 99)
    train(tmp_path / "killed", 3)
    train(tmp_path / "killed", 5)
    again = train(tmp_path / "killed", 99)
    np.testing.assert_array_equal(alone.weights, again.weights)
    lines = [
        len(Journal(tmp_path / n / "feedback.jsonl", SETTINGS).lines) for n in ("alone", "killed")
    ]
    assert lines == [12, 12]


def test_line_cut_off_by_a_kill_is_dropped_and_done_again(tmp_path: Path) -> None:
    alone = train(tmp_path / "alone", 99)
    train(tmp_path / "torn", 7)
    path = tmp_path / "torn" / "feedback.jsonl"
    path.write_bytes(path.read_bytes()[:-40])
    again = train(tmp_path / "torn", 99)
    np.testing.assert_array_equal(alone.weights, again.weights)


def test_finished_run_is_not_folded_again(tmp_path: Path) -> None:
    first = train(tmp_path, 99)
    search, folds = Search(SETTINGS, tmp_path), Bowl()
    assert list(search.run(folds)) == []
    assert folds.folded == 0
    np.testing.assert_array_equal(first.weights, search.weights)


def test_run_goes_on_the_same_with_another_number_of_threads(tmp_path: Path) -> None:
    with threadpool_limits(1):
        alone = train(tmp_path / "alone", 99)
        train(tmp_path / "moved", 6)
    with threadpool_limits(2):
        again = train(tmp_path / "moved", 99)
    np.testing.assert_array_equal(alone.weights, again.weights)


def test_journal_of_other_settings_is_refused_and_says_which(tmp_path: Path) -> None:
    train(tmp_path, 2)
    other = SETTINGS.model_copy(update={"seed": 1})
    with pytest.raises(ConfigurationError, match=r"other settings \(seed is 0 there, 1 here\)"):
        train(tmp_path, 1, other)
    fewer = SETTINGS.model_copy(update={"generations": 1})
    with pytest.raises(ConfigurationError, match="2 generations are done there, 1 asked here"):
        train(tmp_path, 1, fewer)


def test_extended_training_ends_as_one_asked_for_at_first(tmp_path: Path) -> None:
    alone = train(tmp_path / "alone", 99)
    train(tmp_path / "extended", 99, SETTINGS.model_copy(update={"generations": 5}))
    again = train(tmp_path / "extended", 99)
    np.testing.assert_array_equal(alone.weights, again.weights)
    assert alone.validated == again.validated
    first = (tmp_path / "extended" / "feedback.jsonl").read_text().splitlines()[0]
    assert json.loads(first)["settings"]["generations"] == 12


def test_search_goes_down_and_keeps_what_validated_best(tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"generations": 60})
    search = train(tmp_path, 99, settings)
    start = depth(first_weights(np.random.default_rng(0)))
    assert search.validated < 0.8 * start
    assert search.validated == pytest.approx(depth(search.weights))


def test_cost_is_the_papers_reward_and_no_touch_is_the_worst() -> None:
    trace = np.array([[[0.1, 0.1], [0.1, 0.1], [0.05, 0.1]]])
    folds = Folds(np.array([-0.02, np.nan, np.nan]), (None,) * 3, np.full(3, 3.0), trace)
    cost = fold_cost(folds, weight=np.full(3, 10.0), length=0.6, force_weight=0.01)
    assert cost[0] == pytest.approx(0.02 + 0.01 * 0.3)
    assert cost[1] > cost[2] > 0.6


def test_miss_without_a_touch_is_half_a_strip() -> None:
    folds = Folds(np.array([-0.02, np.nan]), (None,) * 2, np.zeros(2), np.zeros((1, 2, 2)))
    assert misses(folds, 0.6) == pytest.approx([0.02, 0.3])


def test_last_generation_is_judged_too(tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"generations": 3, "validate_every": 50})
    search = train(tmp_path, 99, settings)
    assert np.isfinite(search.validated)
    assert not np.array_equal(search.weights, first_weights(np.random.default_rng(0)))


@pytest.mark.parametrize(
    "content",
    [
        b"PK\x03\x04\xff\xfe",
        b"hello\n",
        b"[1]\n",
        b"torn and strange",
        b'{"schema": 1}\n{"a": 1}\n',
    ],
)
def test_file_that_is_no_journal_is_refused_and_kept(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "feedback.jsonl"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"feedback\.jsonl: ") as refused:
        Search(SETTINGS, tmp_path)
    assert "\n" not in str(refused.value)
    assert path.read_bytes() == content


def test_start_draws_a_raised_triangle() -> None:
    network = HeadingNetwork(first_weights(np.random.default_rng(0)))
    heading = network(np.array([[[0.8, 0.2, 0.7], [0.2, 0.3, 0.2]]]))[0] / np.pi
    assert heading == pytest.approx([0.73, 1.25], abs=0.01)
    assert len(first_weights(np.random.default_rng(0))) == WEIGHT_COUNT


def test_papers_range_has_its_corners_and_samples_stay_inside() -> None:
    corner = strip_at(0.0, 1.0)
    assert corner.retardation_time == pytest.approx(50 * paper_damping_minimum(0.02) / 0.02)
    lengths = [strip.bending_length for strip in grid(12)]
    assert min(lengths) == pytest.approx(0.0135, abs=1e-4)
    assert max(lengths) == pytest.approx(0.0333, abs=1e-4)
    drawn = sample(4, np.random.default_rng(0))
    assert len(drawn) == 16
    assert all(0.0135 < strip.bending_length < 0.0334 for strip in drawn)
