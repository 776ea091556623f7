"""Where the board is in a view is what was asked for, and advice follows from it."""

import numpy as np
import pytest

from calibration.board import BoardSettings
from calibration.wizard.coverage import gates, placement, project_outline, wanted_views
from tests.support.board_sessions import LENS, projected, session

SETTINGS = BoardSettings()
WANTED = wanted_views(SETTINGS.lean, SETTINGS.sizes)


@pytest.mark.parametrize("wanted", WANTED, ids=str)
def test_view_that_is_as_wanted_is_placed_so(wanted) -> None:
    view = projected(wanted, np.random.default_rng(0), SETTINGS, noise=0.0)
    found = placement(view, SETTINGS.outline(), LENS)
    assert (found.x, found.y) == pytest.approx((wanted.x, wanted.y), abs=0.02)
    assert (found.tilt, found.turn) == pytest.approx(
        (wanted.tilt, wanted.turn), abs=0.25
    )
    drawn = wanted.outline(SETTINGS.outline(), LENS)
    # px, undistorted
    assert np.abs(drawn - project_outline(view, SETTINGS.outline())).max() < 15.0
    if not wanted.tilt and not wanted.turn:
        assert found.skew < 0.05


def test_wanted_views_lean_and_roll_every_way_and_together_cover_all() -> None:
    for name in ("tilt", "turn", "roll"):
        angles = [getattr(wanted, name) for wanted in WANTED]
        assert sorted(angles) == pytest.approx(sorted(-angle for angle in angles))
    covered = gates([*session(SETTINGS).values()], LENS, SETTINGS)
    assert all(gate.passed for gate in covered), [str(gate) for gate in covered]
    assert [gate.name for gate in gates([], LENS, SETTINGS) if gate.passed] == []
