"""The twin's cell in other looks: named, and drawn as they say."""

import numpy as np
import pytest

from drivers.errors import ConfigurationError
from drivers.settings import parse
from drivers.twin.renderer.looks import (
    DEFAULT_LOOK,
    LOOKS,
    PLAIN,
    Box,
    Flicker,
    Look,
    Pattern,
    StripLook,
)
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.scene import Scene
from drivers.twin.settings import CameraSettings, TwinSettings
from drivers.types import Array, Pose
from tests.support.rendered_cell import empty, midline, scene

QUIET = CameraSettings(noise=0.0)
DENIM = StripLook((40, 60, 110), 0.001, 0.05)
SMALL = CameraSettings(width=640, height=360, noise=0.0)


def _drawn(look: Look, at: Scene, settings: CameraSettings = SMALL) -> Array:
    strip = StripLook(DENIM.colour, DENIM.thickness, DENIM.width, look.pattern)
    return Renderer(settings, strip, 0, surround=look).render([at], 0).astype(float)


def test_unknown_look_is_refused_with_the_names_of_all() -> None:
    with pytest.raises(ConfigurationError, match="there is no look 'fog'") as told:
        parse({"look": "fog"}, TwinSettings, "cell.yaml: twin")
    assert all(name in str(told.value) for name in LOOKS)


def test_plain_look_leaves_no_trace_in_what_is_kept_of_a_cell() -> None:
    assert "look" not in TwinSettings().model_dump(mode="json")
    assert "look" not in TwinSettings(look=DEFAULT_LOOK).model_dump_json()
    assert TwinSettings(look="clutter").model_dump(mode="json")["look"] == "clutter"


def test_camera_stays_itself_in_any_look() -> None:
    assert TwinSettings(look="clutter").camera.identity == TwinSettings().camera.identity


@pytest.mark.parametrize("name", [name for name in LOOKS if name != DEFAULT_LOOK])
def test_every_look_shows_another_picture_than_the_plain_one(name: str) -> None:
    plain, other = (_drawn(LOOKS[it], scene("lifted")) for it in (DEFAULT_LOOK, name))
    assert np.abs(plain - other).mean() > 5


def test_pattern_lies_where_it_should_along_the_strip() -> None:
    strip = StripLook((200, 20, 20), 0.004, 0.05, Pattern("across", 0.1, ((20, 20, 200),)))
    image = Renderer(QUIET, strip, 0).render([scene("flat")], 0).astype(float)
    optics, x = Optics.of(QUIET), np.arange(0.05, 0.6, 0.1)
    u, v = optics.plane(np.column_stack([x, 0 * x])).round().astype(int).T
    reddish = image[v, u, 2] > image[v, u, 0]
    assert reddish.tolist() == [True, False, True, False, True, False]


def test_checks_alternate_over_the_width_as_well() -> None:
    strip = StripLook((0, 0, 0), 0.001, 0.05, Pattern("checks", 0.01, ((255, 255, 255),)))
    tint = strip.tint(np.array([0.005, 0.015, 0.005, 0.015]), np.array([0.0, 0.0, 0.015, 0.015]))
    assert tint is not None
    assert tint[:, 0].tolist() == [0, 255, 255, 0]


def test_strip_without_pattern_has_the_colour_of_its_file_alone() -> None:
    assert DENIM.tint(np.zeros(3), np.zeros(3)) is None


def test_things_stand_still_behind_the_strip_and_never_before_it() -> None:
    wall = Look(things=(Box((0.0, 0.1, 0.0), (0.6, 0.2, 0.3), (250, 250, 250)),))
    bare, covered = (_drawn(look, scene("lifted"), QUIET) for look in (PLAIN, wall))
    points, _ = midline("lifted")
    optics = Optics.of(QUIET)
    u, v = optics.plane(points[60:300:20], 0.02).round().astype(int).T
    assert np.abs(bare[v, u] - covered[v, u]).max() < 60
    there, elsewhere = (
        optics.plane(np.array([at])).round().astype(int)[0] for at in ((0.2, 0.2), (0.65, 0.2))
    )
    assert np.abs(bare - covered)[there[1], there[0]].max() > 100
    assert np.abs(bare - covered)[elsewhere[1], elsewhere[0]].max() < 10


def test_shadow_of_the_arm_moves_with_it() -> None:
    look = LOOKS["arm-shadow"]
    bare = Look(look.colours)
    share = [
        _drawn(look, at) / np.maximum(_drawn(bare, at), 1)
        for at in (empty(0.15, 0.1), empty(0.45, 0.1))
    ]
    places = [np.argmin(one.mean(axis=(0, 2))) for one in share]
    assert places[1] - places[0] == pytest.approx(0.3 / 0.75 * 640, rel=0.25)
    assert all(0.6 < one.min() < 0.75 for one in share)


def test_light_flickers_at_twice_the_mains_and_by_its_depth() -> None:
    look = Look(flicker=Flicker(mains=50.0, depth=0.4, readout=0.0))
    still = _drawn(PLAIN, empty(0.3, 5.0)).mean()
    stamps = np.arange(0.0, 0.02, 0.001)
    bright = [_drawn(look, _at(stamp)).mean() / still for stamp in stamps]
    assert np.allclose(bright[:10], bright[10:], atol=0.01)  # a period is 10 ms
    swing = 0.4 * np.sinc(100 * QUIET.exposure)
    assert max(bright) - min(bright) == pytest.approx(swing, rel=0.1)
    assert np.mean(bright) == pytest.approx(0.8, abs=0.02)


def test_rolling_shutter_shows_flicker_as_bands() -> None:
    look = Look(flicker=Flicker(mains=50.0, depth=0.4, readout=0.010))
    share = _drawn(look, _at(0.0)) / np.maximum(_drawn(PLAIN, _at(0.0)), 1)
    rows = share.mean(axis=(1, 2))
    assert rows.max() - rows.min() > 0.25
    assert np.ptp(share, axis=1).max() < 0.05


@pytest.mark.parametrize("thickness", [0.004, 0.008])
def test_thick_strip_is_as_wide_as_its_thickness_and_what_is_seen_of_its_face(
    thickness: float,
) -> None:
    strip = StripLook((200, 30, 30), thickness, 0.05)
    at, bare = scene("lifted"), empty(0.3, 5.0)
    seen, without = (Renderer(QUIET, strip, 0).render([it], 0).astype(float) for it in (at, bare))
    points, _ = midline("lifted")
    optics, k = Optics.of(QUIET), 540  # hangs, its face in sight
    near, far = (optics.plane(points[k], y) for y in (0.0, 0.05))
    scale = QUIET.distance / QUIET.focal
    row = np.abs(seen - without)[int(near[1])].max(axis=-1)
    columns = slice(int(near[0]) - 60, int(near[0]) + 60)
    found = (row[columns] > 60).sum() * scale
    swept = abs(far[0] - near[0]) * scale
    assert found == pytest.approx(thickness + swept - 0.001, abs=0.0012)


def _at(stamp: float) -> Scene:
    points, arc = midline("flat", nodes=7)
    away = Pose(0.3, 5.0, np.pi / 2)
    return Scene(stamp, points, arc, away, 0.0, holds_strip=False, strip=False)
