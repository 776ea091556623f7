"""The lens from board views in rendered images; what the wizard refuses."""

from functools import lru_cache

import numpy as np
import pytest

from calibration.board_views import BoardPose, BoardSettings, BoardViews, LensVerdict
from drivers.errors import ConfigurationError
from drivers.twin.board import board_frame, facing
from drivers.twin.renderer.optics import Optics
from drivers.twin.settings import CameraSettings
from drivers.types import Frame
from tests.support.twin_calibration import show_boards

CAMERA = CameraSettings()
SETTINGS = BoardSettings()


@lru_cache
def _verdict() -> LensVerdict:
    return show_boards(CAMERA, SETTINGS)


def _frame(pose: BoardPose, sequence: int = 0) -> Frame:
    place = facing(np.array([pose.x, pose.y, pose.z]), pose.tilt, pose.turn, pose.roll)
    return board_frame(CAMERA, SETTINGS.board(), place, seed=2, sequence=sequence)


def test_lens_is_found_through_images_to_half_a_percent() -> None:
    verdict = _verdict()
    assert verdict.passed, verdict.reasons
    assert verdict.fit is not None
    assert verdict.views >= 12
    assert verdict.fit.rms < 0.3
    assert verdict.split < 0.01
    focal = Optics.of(CAMERA).focal
    assert verdict.fit.lens.matrix[0, 0] == pytest.approx(focal, rel=0.005)


def test_frontal_views_are_refused_for_their_lack_of_tilt_though_their_rms_is_small() -> None:
    views = BoardViews(SETTINGS)
    places = [(x, z) for x in (0.12, 0.31, 0.5) for z in (0.10, 0.22)]
    for k, (x, z) in enumerate(places):
        assert views.tell(_frame(BoardPose(x, 0.0, z, 0.0, 0.0, 0.0), k)) is None
    verdict = views.verdict()
    assert not verdict.passed
    assert verdict.fit is not None
    assert verdict.fit.rms < 0.3
    assert any("its top away" in reason for reason in verdict.reasons)
    assert any("its right edge nearer" in reason for reason in verdict.reasons)


def test_view_shown_before_is_refused() -> None:
    views = BoardViews(SETTINGS)
    pose = views.ask()
    assert pose is not None
    assert views.tell(_frame(pose)) is None
    answer = views.tell(_frame(pose, 1))
    assert answer is not None
    assert "was taken before; move the board" in answer


def test_image_without_board_is_refused_and_given_up_after_patience() -> None:
    views = BoardViews(SETTINGS)
    first = views.ask()
    blank = Frame(0.0, 0.0, "test", 0, np.full((720, 1280, 3), 128, np.uint8))
    for _ in range(SETTINGS.patience):
        assert views.ask() == first
        answer = views.tell(blank)
        assert answer is not None
        assert "0 corners of the board are seen" in answer
    assert views.ask() != first


def test_verdict_without_views_says_how_many_are_needed() -> None:
    verdict = BoardViews(SETTINGS).verdict()
    assert not verdict.passed
    assert "0 views, at least 6 are needed" in verdict.reasons[0]


def test_board_with_even_rows_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="rows: is 8, must be odd"):
        BoardViews(BoardSettings(rows=8))


def test_marker_as_large_as_its_square_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="marker: must be smaller than square"):
        BoardViews(BoardSettings(marker=0.03))
