"""The lens from board views in rendered images; what the wizard refuses, and says."""

from functools import lru_cache

import numpy as np
import pytest

from calibration.board import BoardSettings
from calibration.wizard.board_views import BoardViews
from calibration.wizard.coverage import WantedView
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.news import Row
from drivers.errors import ConfigurationError
from drivers.twin.board import Placement, board_frame, board_pose
from drivers.twin.renderer.optics import Optics
from drivers.twin.settings import CameraSettings
from drivers.types import Frame, Image
from tests.support.twin_calibration import show_boards

CAMERA = CameraSettings()
SETTINGS = BoardSettings()


@lru_cache
def _verdict() -> LensVerdict:
    return show_boards(CAMERA, SETTINGS)


@lru_cache
def _image(placement: Placement, sequence: int = 0) -> Image:
    board = SETTINGS.board()
    return board_frame(
        CAMERA, board, board_pose(CAMERA, board, placement), 2, sequence=sequence
    ).image


def _frame(placement: Placement, sequence: int = 0) -> Frame:
    return Frame(0.0, 0.0, "test", sequence, _image(placement, sequence))


def _shown(views: BoardViews, placement: Placement, sequence: int = 0) -> str | None:
    """What comes of two images in a row of a board at rest."""
    told = views.tell(_frame(placement, sequence))
    return views.tell(_frame(placement, sequence)).refused if told.waits else told.refused


@pytest.mark.slow
def test_lens_is_found_through_images_to_half_a_percent() -> None:
    verdict = _verdict()
    assert verdict.passed, verdict.reasons
    assert verdict.fit is not None
    assert verdict.views >= 12
    assert verdict.fit.rms < 0.3
    assert verdict.split < 0.01
    assert verdict.bend_mm < 0.3
    assert max(verdict.per_view.values()) < 0.3
    focal = Optics.of(CAMERA).focal
    assert verdict.fit.lens.matrix[0, 0] == pytest.approx(focal, rel=0.005)


def test_shaken_board_gives_no_view() -> None:
    views = BoardViews(SETTINGS)
    answers = [views.tell(_frame(Placement(0.5 + 0.004 * (k % 2), 0.5, 0.4))) for k in range(6)]
    assert not any(told.taken for told in answers)
    assert "the board moved by 5." in str(answers[1].refused)
    assert "hold it still" in str(answers[1].refused)


@pytest.mark.parametrize(
    ("before", "shown", "remedy"),
    [
        (Placement(0.5, 0.5, 0.4), Placement(0.505, 0.5, 0.4), "taken before; move the board"),
        (None, Placement(0.5, 0.5, 0.125), "come nearer"),
        (None, Placement(0.5, 0.5, 1.6), "too close"),
    ],
)
def test_view_that_is_no_use_is_refused_with_a_remedy(
    before: Placement | None, shown: Placement, remedy: str
) -> None:
    views = BoardViews(SETTINGS)
    assert before is None or _shown(views, before) is None
    assert remedy in str(_shown(views, shown))


def test_image_without_board_is_refused_and_given_up_after_patience() -> None:
    views = BoardViews(SETTINGS)
    first = views.ask()
    blank = Frame(0.0, 0.0, "test", 0, np.full((720, 1280, 3), 128, np.uint8))
    for _ in range(SETTINGS.patience):
        assert views.ask() == first
        assert "0 corners of the board are seen" in str(views.tell(blank).refused)
    assert views.ask() != first


def test_person_is_waited_for_until_he_skips() -> None:
    views = BoardViews(SETTINGS, patient=True)
    first = views.ask()
    blank = Frame(0.0, 0.0, "test", 0, np.full((720, 1280, 3), 128, np.uint8))
    for _ in range(5 * SETTINGS.patience):
        views.tell(blank)
    assert views.ask() == first
    views.skip()
    assert views.ask() != first


def test_view_that_nobody_asked_for_counts() -> None:
    views = BoardViews(SETTINGS)
    first = views.ask()
    assert _shown(views, Placement(0.16, 0.73, 0.31, -0.28, 0.28)) is None
    assert views.ask() == first
    assert {gate.name: gate.have for gate in views.gates()}["views"] == 1
    views.skip()
    views.skip()
    views.skip()
    assert views.ask() == WantedView(0.84, 0.27, 0.31, SETTINGS.lean / 2, -SETTINGS.lean / 2)


def test_wanted_view_is_described_in_words() -> None:
    assert str(WantedView(0.5, 0.5, 0.4)) == (
        "the middle, 40 % of the image wide, facing the camera"
    )
    assert str(WantedView(0.2, 0.7, 0.3, 0.5, -0.5)) == (
        "low and left, 30 % of the image wide, top away by 29 deg, right edge nearer by 29 deg"
    )


def test_image_of_another_size_is_refused() -> None:
    views = BoardViews(SETTINGS)
    assert _shown(views, Placement(0.5, 0.5, 0.4)) is None
    turned = np.ascontiguousarray(np.swapaxes(_image(Placement(0.5, 0.5, 0.4)), 0, 1))
    answer = views.tell(Frame(0.0, 0.0, "test", 1, turned)).refused
    assert answer == "the image is 720 x 1280 px, the others are 1280 x 720 px; set the camera back"


def test_newest_view_can_be_taken_back() -> None:
    views = BoardViews(SETTINGS)
    wanted = views.ask()
    assert _shown(views, Placement(0.5, 0.5, 0.4)) is None
    assert views.ask() != wanted
    assert views.take_back() == Row(number=1, dropped=True)
    assert views.ask() == wanted
    assert views.take_back() is None
    assert views.verdict(None).views == 0


def test_board_with_even_rows_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="rows: is 8, must be odd"):
        BoardViews(BoardSettings(rows=8))


def test_marker_as_large_as_its_square_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="marker: must be smaller than square"):
        BoardViews(BoardSettings(marker=0.03))
