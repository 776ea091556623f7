"""What touched points amount to, from points alone."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.wizard.touch_verdict import touch_verdict
from calibration.wizard.touches import TouchedPoint, TouchSettings, held_out, touch_plan
from drivers.twin.renderer.optics import Optics
from drivers.twin.settings import CameraSettings
from tests.support.board_sessions import LENS

SETTINGS = TouchSettings()
CAMERA = CameraSettings(principal=(5.5, -4.5))
OPTICS = Optics.from_settings(CAMERA)


def _points(
    noise: float = 0.05, seed: int = 0, settings: TouchSettings = SETTINGS
) -> list[TouchedPoint]:
    """The grid, as the twin's optics show it, with noise [px]."""
    rng = np.random.default_rng(seed)
    points = []
    for k, (x, z, _) in enumerate(touch_plan(settings)):
        place = np.array([x, z])
        pixel = OPTICS.plane(place) + noise * rng.standard_normal(2)
        points.append(TouchedPoint(k, place, pixel, held_out(k, settings)))
    return points


def test_order_of_touches_has_no_influence() -> None:
    points = _points()
    points[4] = replace(points[4], position=points[4].position + 0.02)
    order = np.random.default_rng(3).permutation(len(points))
    one = touch_verdict(points, LENS, SETTINGS)
    other = touch_verdict([points[i] for i in order], LENS, SETTINGS)
    told, told_again = (
        (v.plane_map.homography.matrix.tolist(), v.reasons, v.rejected, v.halves_mm)
        for v in (one, other)
    )
    assert told == told_again


def test_two_points_that_decide_are_too_few_and_so_is_a_half_of_five() -> None:
    deciding = [p.number for p in _points() if p.held_out][:2]
    few = [replace(p, held_out=p.number in deciding) for p in _points()]
    verdict = touch_verdict(few, LENS, SETTINGS)
    assert not verdict.passed
    assert "2 held-out points, at least 3 must decide; touch more" in verdict.reasons
    fewer = [replace(p, pixel=p.pixel + 90 * (p.number < 4)) for p in few[::2]]
    assert np.isnan(touch_verdict(fewer, LENS, SETTINGS).halves_mm)


def test_map_whose_halves_differ_is_refused_though_its_held_out_points_agree() -> None:
    verdict = touch_verdict(_points(noise=0.6, seed=1), LENS, SETTINGS)
    (reason,) = verdict.reasons
    assert reason.startswith(
        "maps from two halves of the points differ by 1.66 mm, allowed 1.50"
    )
    assert verdict.worst_mm < SETTINGS.worst_mm


def test_points_on_one_side_are_refused() -> None:
    many = TouchSettings(columns=12)
    lying = [p for p in _points(settings=many) if p.position[0] < 0.3]
    verdict = touch_verdict(lying, LENS, many)
    assert not verdict.passed
    reasons = "\n".join(verdict.reasons)
    assert "of the work area, at least 60 % are needed; touch its" in reasons


def test_wrong_lens_shows_in_the_held_out_points() -> None:
    """Through a lens without distortion no plane fits: the worst point tells, not the
    rms.
    """
    straight = type(LENS)(LENS.width, LENS.height, LENS.matrix, np.zeros(5))
    bent = Optics.from_settings(CAMERA.model_copy(update={"distortion": (-0.6, 0.3)}))
    points = [replace(p, pixel=bent.plane(p.position)) for p in _points()]
    verdict = touch_verdict(points, straight, SETTINGS)
    assert not verdict.passed


def test_effect_on_the_displacement_is_twice_the_error_along_the_strip() -> None:
    points, off = _points(noise=0.0), np.array([4e-4, 0.0])
    moved = [replace(p, position=p.position + off * p.held_out) for p in points]
    verdict = touch_verdict(moved, LENS, SETTINGS)
    assert verdict.residual_mm == pytest.approx(0.4, abs=0.05)
    assert verdict.displacement_mm == pytest.approx(0.8, abs=0.1)
    assert verdict.passed
    assert not verdict.clean
