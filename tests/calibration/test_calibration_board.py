"""The lens from board views in rendered images; what the wizard refuses, and says."""

from functools import lru_cache

import numpy as np
import pytest

from calibration.board import BoardSettings
from calibration.wizard.board_views import BoardViews
from drivers.base.types import BoardPlacement as Placement, Frame, Image
from drivers.twin.board import board_frame, board_pose
from drivers.twin.settings import CameraSettings

CAMERA = CameraSettings()
SETTINGS, SIZE = BoardSettings(), (1280, 720)


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
    return (
        views.tell(_frame(placement, sequence)).refused if told.waits else told.refused
    )


def test_shaken_board_gives_no_view() -> None:
    views = BoardViews(SETTINGS, SIZE)
    answers = [
        views.tell(_frame(Placement(0.5 + 0.004 * (k % 2), 0.5, 0.4))) for k in range(6)
    ]
    assert not any(told.taken for told in answers)
    assert "the board moved by 5." in str(answers[1].refused)
    assert "hold it still" in str(answers[1].refused)


@pytest.mark.parametrize(
    ("before", "shown", "remedy"),
    [
        (
            Placement(0.5, 0.5, 0.4),
            Placement(0.505, 0.5, 0.4),
            "taken before; move the board",
        ),
        (None, Placement(0.5, 0.5, 0.125), "come nearer"),
        (None, Placement(0.5, 0.5, 1.6), "too close"),
    ],
)
def test_view_that_is_no_use_is_refused_with_a_remedy(
    before: Placement | None, shown: Placement, remedy: str
) -> None:
    views = BoardViews(SETTINGS, SIZE)
    assert before is None or _shown(views, before) is None
    assert remedy in str(_shown(views, shown))


BLANK = Frame(0.0, 0.0, "test", 0, np.full((720, 1280, 3), 128, np.uint8))


def test_image_without_board_is_refused_and_given_up_after_patience() -> None:
    views = BoardViews(SETTINGS, SIZE)
    first = views.ask()
    for _ in range(SETTINGS.patience):
        assert views.ask() == first
        assert "0 corners of the board are seen" in str(views.tell(BLANK).refused)
    assert views.ask() != first


def test_person_is_waited_for_until_he_skips() -> None:
    views = BoardViews(SETTINGS, SIZE, patient=True)
    first = views.ask()
    for _ in range(5 * SETTINGS.patience):
        views.tell(BLANK)
    assert views.ask() == first
    views.skip()
    assert views.ask() != first
