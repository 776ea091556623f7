"""The camera's latency from steps of the arm: found within 5 ms, or refused."""

import numpy as np
import pytest

from calibration.wizard.latency import LatencySettings, LatencyVerdict, latency_verdict
from drivers.types import Array
from tests.support.board_sessions import LENS, MAP, arm_steps, images_of, steps_of


def _verdict(latency: float, noise: float = 0.1, jitter: float = 0.0) -> LatencyVerdict:
    rng = np.random.default_rng(1)
    arm = arm_steps(rng)
    stamps = np.arange(0.5, 9.5, 0.1)
    shown = stamps - latency + jitter * rng.standard_normal(len(stamps))
    x = np.interp(shown, arm[:, 0], arm[:, 1])
    steps = steps_of(arm, images_of(stamps, x, noise, rng))
    return latency_verdict(steps, LENS, MAP, LatencySettings(), 0.1)


@pytest.mark.parametrize("latency", [-0.02, 0.0, 0.013, 0.06, 0.19])
def test_latency_is_found_within_a_millisecond(latency: float) -> None:
    verdict = _verdict(latency)
    assert verdict.passed, verdict.reasons
    assert verdict.latency == pytest.approx(latency, abs=1e-3)


STILL = np.column_stack([np.arange(0, 5, 0.01), np.full((500, 2), 0.2)])
SEEN = np.column_stack([0.1 * np.arange(40), np.full(40, 400.0), np.full(40, 300.0)])


def test_unsteady_stamps_are_refused() -> None:
    assert not _verdict(0.03, jitter=0.08).passed


@pytest.mark.parametrize(
    ("arm", "seen", "reason"),
    [
        (STILL, SEEN, "0 images show the pointer under way, 10 are needed"),
        (STILL, SEEN[:0], "no step of the arm was seen; step again"),
    ],
)
def test_steps_that_show_no_motion_are_refused(arm: Array, seen: Array, reason: str) -> None:
    found = latency_verdict(steps_of(arm, seen), LENS, MAP, LatencySettings(), 0.1)
    assert reason in found.reasons[0]
