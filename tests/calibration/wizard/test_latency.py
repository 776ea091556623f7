"""The camera's latency from steps of the arm: found within 5 ms, or refused."""

import numpy as np
import pytest

from calibration.homography import PlaneMap
from calibration.wizard.latency import LatencySettings, LatencySteps, latency_verdict
from tests.support.board_sessions import LENS, MAP, arm_steps, steps_seen


def _verdict(latency: float, jitter: float = 0.0):
    rng = np.random.default_rng(1)
    arm = arm_steps(rng)
    stamps = np.arange(0.5, 9.5, 0.1)
    shown = stamps - latency + jitter * rng.standard_normal(len(stamps))
    steps = steps_seen(arm, stamps, shown, 0.1, rng)
    return latency_verdict(steps, PlaneMap(LENS, MAP), LatencySettings())


@pytest.mark.parametrize("latency", [-0.02, 0.0, 0.013, 0.06, 0.19])
def test_latency_is_found_within_a_millisecond(latency: float) -> None:
    verdict = _verdict(latency)
    assert verdict.passed, verdict.reasons
    assert verdict.latency == pytest.approx(latency, abs=1e-3)


def test_unsteady_stamps_are_refused() -> None:
    assert not _verdict(0.03, jitter=0.08).passed


@pytest.mark.parametrize(
    ("images", "reason"),
    [
        (40, "0 images show the pointer under way, 10 are needed"),
        (0, "no step of the arm was seen; step again"),
    ],
)
def test_steps_that_show_no_motion_are_refused(images: int, reason: str) -> None:
    arm = [(0.01 * k, 0.2, 0.2) for k in range(500)]
    steps = LatencySteps(arm=arm, seen=[(0.1 * k, 400.0, 300.0) for k in range(images)])
    assert (
        reason
        in latency_verdict(steps, PlaneMap(LENS, MAP), LatencySettings()).reasons[0]
    )
