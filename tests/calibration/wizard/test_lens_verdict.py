"""What a session with the board amounts to: poor ones are refused, with the reason."""

from dataclasses import replace

import pytest

from calibration.board import BoardSettings
from calibration.wizard.lens_verdict import LensVerdict, fit_views, lens_verdict
from tests.support.board_sessions import LENS, session

SETTINGS = BoardSettings()
SIZE = (LENS.width, LENS.height)


def _verdict(settings: BoardSettings = SETTINGS, **facts: object) -> LensVerdict:
    length, size = facts.pop("length", SETTINGS.width), facts.pop("size", SIZE)
    count = facts.pop("count", None)
    views = dict([*session(settings, **facts).items()][:count])
    return lens_verdict(views, size, length, settings)


def _says(verdict: LensVerdict, text: str) -> bool:
    return any(text in reason for reason in verdict.reasons)


def test_good_session_passes_and_its_halves_agree() -> None:
    verdict = _verdict()
    assert verdict.passed, verdict.reasons
    assert verdict.fit.lens.matrix[0, 0] == pytest.approx(LENS.matrix[0, 0], rel=0.003)
    assert verdict.bend_mm < 0.3
    assert set(verdict.per_view) == set(range(13))


def test_coefficient_that_a_board_hardly_shows_is_not_fitted() -> None:
    fit = fit_views([*session(SETTINGS).values()], SIZE)
    assert fit.lens.distortion[4] == 0.0


def test_frontal_views_are_refused_though_their_rms_is_small() -> None:
    verdict = _verdict(lean=0.0)
    assert not verdict.passed
    assert verdict.fit.rms < 0.1
    for edge in ("its top", "its right edge"):
        for lean in ("away", "nearer"):
            assert _says(verdict, f"{edge} {lean}: 0 of 2 views")


def test_square_two_percent_wrong_is_seen_by_the_ruler_alone() -> None:
    wrong = SETTINGS.model_copy(update={"square": 1.02 * SETTINGS.square})
    views = session(SETTINGS)
    scaled = {k: replace(view, board=1.02 * view.board) for k, view in views.items()}
    blind = lens_verdict(scaled, SIZE, wrong.width, wrong)
    assert blind.passed
    verdict = lens_verdict(scaled, SIZE, SETTINGS.width, wrong)
    assert verdict.fit.rms == pytest.approx(blind.fit.rms, rel=1e-6)
    assert verdict.fit.rms < 0.1
    assert verdict.reasons == (
        (
            "9 squares measure 252.0 mm, configured are 257.0 mm, +2.0 %; state"
            " boards.square: 0.02800 or print the board at 100 %"
        ),
    )


@pytest.mark.parametrize(
    ("facts", "reason"),
    [
        ({"length": None}, "no length of the board was measured; lay a ruler"),
        ({"noise": 1.2}, "hold the board still and flat"),
        ({"lean": 0.2, "noise": 0.3}, "the focal length is known to"),
        (
            {"size": SIZE[::-1]},
            "outside of an image of 720 x 1280 px; state its width first",
        ),
        ({"count": 5}, "5 views, at least 6 are needed; show more"),
    ],
    ids=["no ruler", "shaken", "noise", "swapped size", "few"],
)
def test_poor_session_is_refused_with_the_reason(
    facts: dict[str, object], reason: str
) -> None:
    verdict = _verdict(**facts)
    assert not verdict.passed
    assert _says(verdict, reason)


def test_halves_of_two_cameras_are_refused() -> None:
    views, centre = session(SETTINGS), LENS.matrix[:2, 2]
    across = sorted(views, key=lambda number: tuple(views[number].image.mean(axis=0)))
    mixed = dict(views)
    for number in across[1::2]:  # every other view, as the halves are
        view = views[number]
        shrunk = centre + 0.95 * (view.image - centre)
        mixed[number] = replace(view, image=shrunk)
    verdict = lens_verdict(mixed, SIZE, SETTINGS.width, SETTINGS)
    assert _says(verdict, "two halves of the views differ")


def test_order_of_views_has_no_influence() -> None:
    views = session(SETTINGS)
    shuffled = dict(sorted(views.items(), key=lambda item: (7 * item[0]) % 13))
    one, other = (
        lens_verdict(given, SIZE, SETTINGS.width, SETTINGS).fit.lens
        for given in (views, shuffled)
    )
    assert one.matrix == pytest.approx(other.matrix, rel=1e-6)
    assert one.distortion == pytest.approx(other.distortion, rel=1e-5)


def test_a_program_is_told_that_a_lens_is_refused() -> None:
    assert LensVerdict(reasons=("blurred",)).facts()["passed"] is False
