"""One picture before grasping: what passes, what is refused and what it tells to do."""

import re
from itertools import chain, repeat
from types import SimpleNamespace

import numpy as np
import pytest

from cell.perception.preflight import (
    Preflight,
    _check_flat,
    _check_length,
    _check_level,
    inspect,
)
from cell.perception.resting_strip import Underside, sample_scene
from drivers.base.types import Array, Frame, Pose
from drivers.strip.describe import load_strip
from drivers.strip.file import StripFile
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import flat, lying
from tests.support.requests import DENIM
from tests.support.seen_folds import STRIPS
from tests.support.twin_calibration import twin_calibration

CAMERA = CameraSettings()
AWAY = Pose(0.65, 0.25, 0.0)


def _picture(points: Array, look: StripLook, *, strip: bool = True) -> Frame:
    scene = lying(points, AWAY, strip=strip)
    return Frame(0.0, 0.02, "test", 0, Renderer(CAMERA, look, 0).render([scene], 0))


def _judged(frame: Frame, strip: StripFile = DENIM) -> Preflight:
    return inspect(frame, twin_calibration(CAMERA), strip)


@pytest.mark.parametrize("off", [0.006, -0.006])
def test_line_of_the_edge_may_leave_neither_itself_nor_the_desk_to_any_side(
    off: float,
) -> None:
    x = np.linspace(0.0, 0.6, 301)
    straight = SimpleNamespace(rest_height=lambda x: 0.0 * x)
    high = SimpleNamespace(rest_height=lambda x: 0.0 * x + 2 * off)
    bent = Underside(x, off * (np.abs(x - 0.3) < 0.05), 0.6)
    for seen, rests, names in (
        (bent, straight, ["flat and straight"]),
        (Underside(x, 0.0 * x + 2 * off, 0.6), high, ["on the desk plane"]),
        (Underside(x, 0.0 * x, 0.6 + 3 * off), straight, ["length"]),
        (Underside(x, 0.0 * x, 0.6), straight, []),
    ):
        checks = [_check_flat(seen, rests), _check_level(seen, rests)]
        checks.append(_check_length(seen, DENIM, 0.0003))
        assert [check.name for check in checks if not check.passed] == names


def _failed(judged: Preflight) -> list[str]:
    return [check.name for check in judged.checks if not check.passed]


@pytest.mark.parametrize(
    "path", sorted(STRIPS.glob("*.yaml")), ids=lambda path: path.stem
)
def test_every_strip_lying_flat_passes_and_its_colour_is_sampled(path: object) -> None:
    strip = load_strip(path)  # type: ignore[arg-type]
    picture = _picture(flat(), StripLook.from_file(strip))
    judged = _judged(picture, strip)
    assert _failed(judged) == []
    seen = sample_scene(picture.image, twin_calibration(CAMERA), strip)
    assert max(seen.strip.std(axis=0).max(), seen.desk.std(axis=0).max()) < 20, (
        "of two surfaces"
    )
    off = judged.appearance.scene.colours[0] - np.array(strip.colour[::-1])
    assert np.abs(off).max() < 30
    x = np.linspace(0.02, 0.58, 20)
    assert np.abs(judged.appearance.rest_height(x)).max() < 0.0004


def _wrinkled() -> Array:
    points = flat()
    points[:, 1] = 0.008 * np.exp(-(((points[:, 0] - 0.3) / 0.03) ** 2))
    return points


LOOK, MAT = StripLook.from_file(DENIM), StripLook(CAMERA.surroundings.desk, 0.001, 0.05)


@pytest.mark.parametrize(
    ("points", "look", "check"),
    [
        (flat(0.57), LOOK, "length"),
        (flat(0.4), LOOK, "strip lies there"),
        (flat() - (0.0, 0.002), LOOK, "on the desk plane"),
        (flat(), MAT, "contrast"),
        (_wrinkled(), LOOK, "strip lies there"),
    ],
)
def test_strip_that_does_not_lie_as_stated_is_refused(
    points: Array, look: StripLook, check: str
) -> None:
    judged = _judged(_picture(points, look))
    assert check in _failed(judged)


def test_map_that_is_off_in_height_is_told_of_a_thin_strip_and_no_cloth() -> None:
    thin = load_strip(STRIPS / "swimwear.yaml")
    moved = flat() - (0.0, 0.005)
    judged = _judged(_picture(moved, StripLook.from_file(thin)), thin)
    assert _failed(judged) == ["on the desk plane"]


def test_strip_that_passes_only_off_the_desk_is_refused(monkeypatch) -> None:
    refused, seen = Preflight((), None), Preflight((), object())
    judged = chain([refused], repeat(seen))
    place = "cell.perception.preflight._inspect_at"
    monkeypatch.setattr(place, lambda *_: next(judged))
    assert _judged(_picture(flat(), LOOK)) is refused


def test_empty_desk_is_refused_and_says_what_to_do() -> None:
    judged = _judged(_picture(flat(), LOOK, strip=False))
    assert judged.appearance is None
    assert "strip lies there" in _failed(judged)
    assert all(check.remedy for check in judged.checks)


def test_short_strip_is_refused_with_its_length() -> None:
    judged = _judged(_picture(flat(0.57), LOOK))
    reason = next(check.reason for check in judged.checks if check.name == "length")
    assert re.search(r"x = (568|569|570) mm", reason)


def test_thicker_strip_than_a_fold_accepts_is_refused_by_its_picture_too() -> None:
    judged = _judged(
        _picture(flat(), LOOK), DENIM.model_copy(update={"thickness": 0.005})
    )
    assert _failed(judged) == ["thickness"]
