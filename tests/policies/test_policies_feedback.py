"""The feedback policy: the paper's network, its checkpoint, and what it may never
do.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from drivers.strip.file import paper_strip
from policies.feedback import (
    WEIGHT_COUNT,
    Checkpoint,
    Feedback,
    Training,
    load_checkpoint,
    save_checkpoint,
)
from policies.policy import Observation
from policies.registry import make_policy

STRIP = paper_strip(0.1, 0.01)


def observation(x: Array, z: Array, contact: Array) -> Observation:
    blank = np.full(len(x), np.nan)
    return Observation(np.zeros(len(x)), x, z, np.zeros(len(x)), contact, blank, blank)


def checkpoint(weights: Array) -> Checkpoint:
    training = Training(seed=0, generations=1, folds=1)
    return Checkpoint(
        schema=1, policy="feedback", weights=tuple(weights), training=training
    )


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
