"""Training: deterministic, survives kills, and makes the policy better."""

from pathlib import Path

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from policies.rollout import Folds
from policies.train import objective
from policies.train.journal import TrainingJournal
from policies.train.objective import (
    Scores,
    TrainingSettings,
    evaluate_piece,
    fold_cost,
    validate,
)
from policies.train.search import FeedbackTraining, initial_weights
from tests.support.refusals import refusal

SETTINGS = TrainingSettings(generations=12, population=6, validate_every=2)


def bowl(candidates: Array, generation: int) -> Scores:
    """A cost that also depends on the generation, as sampled strips do."""
    wobble = np.random.default_rng(generation).normal() * 1e-3
    miss = np.sum((candidates - 1.0) ** 2, axis=1)
    return Scores(cost=miss + wobble, miss=miss)


def depth(weights: Array) -> float:
    return float(np.sum((weights - 1.0) ** 2))


def in_bowl(compute, calls):
    """Computes the bowl instead of folding."""
    shape = {evaluate_piece: bowl, validate: depth}[compute]
    return enumerate(shape(*asked) for _settings, *asked in calls)


def train(
    folder: Path, generations: int, settings: TrainingSettings = SETTINGS
) -> FeedbackTraining:
    search = FeedbackTraining(settings, folder)
    run = search.run(in_bowl)
    for _ in range(generations):
        if next(run, None) is None:
            break
    return search


def test_run_killed_twice_ends_with_the_weights_of_one_left_alone(
    tmp_path: Path,
) -> None:
    alone = train(tmp_path / "alone", 99)
    train(tmp_path / "killed", 3)
    train(tmp_path / "killed", 5)
    again = train(tmp_path / "killed", 99)
    np.testing.assert_array_equal(alone.weights, again.weights)
    paths = [tmp_path / name / "feedback.jsonl" for name in ("alone", "killed")]
    assert [
        len(TrainingJournal(path, SETTINGS, frozenset()).lines) for path in paths
    ] == [12, 12]


def test_journal_of_other_settings_is_refused_and_says_which(tmp_path: Path) -> None:
    train(tmp_path, 2)
    for change, said in (
        ({"seed": 1}, r"other settings \(seed is 0 there, 1 here\)"),
        ({"generations": 1}, "2 generations are done there, 1 asked here"),
    ):
        with refusal(said):
            train(tmp_path, 1, SETTINGS.model_copy(update=change))


def test_search_goes_down_and_keeps_what_validated_best(tmp_path: Path) -> None:
    settings = SETTINGS.model_copy(update={"generations": 60})
    search = train(tmp_path, 99, settings)
    start = depth(initial_weights(np.random.default_rng(0)))
    assert search.validated < 0.8 * start
    assert search.validated == pytest.approx(depth(search.weights))


def test_validation_is_worse_for_one_bad_strip_than_for_many_fair_ones(
    monkeypatch,
) -> None:
    monkeypatch.setattr(objective, "fold_all", lambda **_: None)
    monkeypatch.setattr(objective, "misses", lambda *_: np.array([0.0, 0.008]))
    assert validate(SETTINGS, np.ones(1)) > 0.005


def test_cost_is_the_papers_reward_and_no_touch_is_the_worst() -> None:
    trace = np.array([[[0.1, 0.1], [0.1, 0.1], [0.05, 0.1]]])
    force = np.full(3, 3.0)
    folds = Folds(np.array([-0.02, np.nan, np.nan]), (None,) * 3, force, force, trace)
    cost = fold_cost(folds, weight=np.full(3, 10.0), length=0.6, force_weight=0.01)
    assert cost[0] == pytest.approx(0.02 + 0.01 * 0.3)
    assert cost[1] > cost[2] > 0.6


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
def test_file_that_is_no_journal_is_refused_and_kept(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "feedback.jsonl"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"feedback\.jsonl: ") as refused:
        FeedbackTraining(SETTINGS, tmp_path)
    assert "\n" not in str(refused.value)
    assert path.read_bytes() == content
