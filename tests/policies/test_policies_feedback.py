"""The feedback policy: the paper's network, its checkpoint, and what it may never do."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigurationError
from drivers.strip.file import paper_strip
from drivers.types import Array
from policies.checkpoint import Checkpoint, Training, load_checkpoint, save_checkpoint
from policies.feedback import COMMITTED, Feedback, load_feedback
from policies.network import INPUT_CENTRE, INPUT_SPREAD, WEIGHT_COUNT, HeadingNetwork
from policies.policy import Observation
from policies.registry import make_policy

STRIP = paper_strip(0.1, 0.01)


def observation(x: Array, z: Array, contact: Array) -> Observation:
    blank = np.full(len(x), np.nan)
    return Observation(np.zeros(len(x)), x, z, np.zeros(len(x)), contact, blank, blank)


def checkpoint(weights: Array) -> Checkpoint:
    training = Training(seed=0, generations=1, folds=1)
    return Checkpoint(schema=1, policy="feedback", weights=tuple(weights), training=training)


def test_network_is_one_hidden_layer_of_twenty_tanh_units() -> None:
    rng = np.random.default_rng(0)
    weights = rng.normal(size=WEIGHT_COUNT)
    state = rng.uniform(size=(5, 3))
    inward, bias, outward, last = np.split(weights, [60, 80, 100])
    seen = np.linalg.solve(np.array(INPUT_SPREAD), (state - INPUT_CENTRE).T).T
    hidden = np.tanh(seen @ inward.reshape(20, 3).T + bias)
    expected = math.pi * (1 + 0.5 * (hidden @ outward + last))
    found = HeadingNetwork(weights)(state[None])[0]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_candidates_side_by_side_decide_like_each_alone() -> None:
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(3, WEIGHT_COUNT))
    x, z, contact = rng.uniform(0.1, 0.4, size=(3, 6))
    together = Feedback(weights)
    together.reset(STRIP, 0.1, 6)
    found = together.decide(observation(x, z, contact)).direction.reshape(3, 2)
    for j in range(3):
        alone = Feedback(weights[j])
        alone.reset(STRIP, 0.1, 2)
        part = slice(2 * j, 2 * j + 2)
        expected = alone.decide(observation(x[part], z[part], contact[part])).direction
        np.testing.assert_allclose(found[j], expected, rtol=1e-12)


def test_direction_always_has_a_part_toward_the_fixed_edge() -> None:
    rng = np.random.default_rng(2)
    policy = Feedback(rng.normal(size=WEIGHT_COUNT) * 5)
    policy.reset(STRIP, 0.1, 500)
    x, z, contact = rng.uniform([[-0.2], [0.0], [0.0]], [[0.6], [0.6], [0.6]], size=(3, 500))
    direction = policy.decide(observation(x, z, contact)).direction
    assert np.all(np.cos(direction) < 1e-9)
    assert np.all(np.sin(direction)[z < 0.03] >= -1e-9)
    assert np.all(np.sin(direction)[z > 0.45] <= 1e-9)


def test_unseen_contact_is_replaced_by_the_last_one_seen() -> None:
    policy = Feedback(np.random.default_rng(3).normal(size=WEIGHT_COUNT))
    policy.reset(STRIP, 0.1, 1)
    x, z, gone = np.array([0.3]), np.array([0.2]), np.array([np.nan])
    blind = policy.decide(observation(x, z, gone)).direction
    assert blind == pytest.approx(0.75 * math.pi)
    seen = policy.decide(observation(x, z, np.array([0.25]))).direction
    assert policy.decide(observation(x, z, gone)).direction == seen
    policy.reset(STRIP, 0.1, 1)
    assert policy.decide(observation(x, z, gone)).direction == blind


def test_fold_ends_once_the_gripper_has_gone_by_the_fixed_edge() -> None:
    policy = Feedback(np.zeros(WEIGHT_COUNT))
    policy.reset(STRIP, 0.1, 2)
    decision = policy.decide(
        observation(np.array([-0.13, 0.1]), np.array([0.1, 0.1]), np.array([0.0, 0.1]))
    )
    assert decision.done.tolist() == [True, False]
    assert decision.speed.tolist() == [0.0, 0.1]


def test_checkpoint_comes_back_bit_for_bit(tmp_path: Path) -> None:
    weights = np.random.default_rng(4).normal(size=WEIGHT_COUNT)
    save_checkpoint(tmp_path / "w.json", checkpoint(weights))
    found = np.array(load_checkpoint(tmp_path / "w.json").weights)
    np.testing.assert_array_equal(found, weights)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x80\x04torn pickle",
        b"[1, 2]",
        b'{"schema": 1, "policy": "feedback"}',
        json.dumps({"schema": 1, "policy": "feedback", "weights": [0.0] * 7}).encode(),
        b'{"schema": 2, "policy": "feedback"}',
    ],
)
def test_corrupt_checkpoint_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.json"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"broken\.json: "):
        make_policy("feedback", path)


def test_checkpoint_with_numbers_that_are_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "w.json"
    save_checkpoint(path, checkpoint(np.zeros(WEIGHT_COUNT)))
    path.write_text(path.read_text().replace("0.0", "NaN", 1))
    with pytest.raises(ConfigurationError, match=r"weights\.0"):
        load_feedback(path)


def test_missing_checkpoint_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be read") as caught:
        load_feedback(tmp_path / "nowhere.json")
    assert "\n" not in str(caught.value)


def test_committed_checkpoint_is_loaded() -> None:
    policy = make_policy("feedback")
    assert policy.name == "feedback"
    assert load_checkpoint(COMMITTED).training.folds > 0
