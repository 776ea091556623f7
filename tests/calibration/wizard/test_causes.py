"""What goes wrong in a calibration is named for what it is, and clean sessions are not
refused.
"""

import numpy as np
import pytest

from calibration.board import BoardSettings
from calibration.homography import PlaneMap
from calibration.wizard.latency import LatencySettings, latency_verdict
from calibration.wizard.lens_verdict import lens_verdict
from calibration.wizard.touch_verdict import touch_verdict
from tests.support.board_sessions import LENS, MAP, arm_steps, bent_session, steps_seen
from tests.support.touch_sessions import SETTINGS as TOUCHES, Camera, touched

BOARD, WILD = BoardSettings(), 0.1  # ..., share of loose touches


def board(seed: int, height: float = 0.0) -> tuple[str, ...]:
    """Reasons against a lens from a board bent by `height` [m] along its long side."""
    views = bent_session(BOARD, height, seed)
    return lens_verdict(views, (1280, 720), BOARD.width, BOARD).reasons


def touches(seed: int, mrad: float = 0.0, *, mirrored: bool = False) -> tuple[str, ...]:
    """Reasons against the map of a camera that turns by `mrad` somewhere among the
    touches.
    """
    rng = np.random.default_rng(seed)
    camera, angle, after = (
        Camera.drawn(rng),
        rng.uniform(0, 2 * np.pi),
        int(rng.integers(5, 20)),
    )
    nudge = 1e-3 * mrad * np.array([np.sin(angle), np.cos(angle), 0.0])
    made = touched(camera, rng, nudge=nudge, after=after, mirrored=mirrored, wild=WILD)
    return touch_verdict(made, camera.lens, TOUCHES).reasons


@pytest.mark.parametrize("height", [0.0007, 0.001, 0.003])
def test_bent_board_is_refused_as_bent(height: float) -> None:
    (reason,) = board(3, height)
    assert f"the board is bent by {1e3 * height:.1f} mm" in reason


@pytest.mark.parametrize("mrad", [0.3, 0.7, 2.0])
def test_camera_that_moved_among_the_touches_is_named(mrad: float) -> None:
    (reason,) = touches(5, mrad)
    assert "the camera moved" in reason
    assert "number 6" in reason  # seven touches were made before


@pytest.mark.parametrize("seed", [61, 98])  # with one wild touch by a few others
def test_wild_touch_is_no_moved_camera(seed: int) -> None:
    assert touches(seed) == ()


def test_mirrored_touches_are_named() -> None:
    (reason,) = touches(2, mirrored=True)
    assert "mirrored" in reason


def test_stamps_that_drift_are_named() -> None:
    rng = np.random.default_rng(1)
    arm, stamps = arm_steps(rng), np.arange(0.5, 9.5, 0.1)
    shown = stamps - 0.03 - 0.002 * (stamps - 5.0)
    steps = steps_seen(arm, stamps, shown, 0.1, rng)
    (reason,) = latency_verdict(steps, PlaneMap(LENS, MAP), LatencySettings()).reasons
    assert "stamps drift" in reason
    assert "+18 ms over 9 s" in reason
