"""layer_touch from sights: both signals, or nothing."""

from collections.abc import Callable

import numpy as np
import pytest

from cell.perception.layer_touch import LayerTouch
from cell.perception.strip_measurement import SeenTouch, StripMeasurement
from drivers.base.types import Array, Pose
from drivers.strip.file import StripFile
from tests.support.requests import DENIM

TIP, PLACE, HEIGHT = 0.33, 0.27, 0.20
GRIPPER = Pose(0.22, HEIGHT, np.pi / 2)


def _profile(gap: float) -> Array:
    """From the contact around the fold, down to `gap` over the desk at PLACE, up to the
    hand.
    """
    angle = np.linspace(-np.pi / 2, np.pi / 2, 30)
    fold = np.stack(
        [TIP - 0.008 + 0.008 * np.cos(angle), 0.008 + 0.008 * np.sin(angle)], 1
    )
    x = np.linspace(TIP - 0.01, GRIPPER.x, 120)
    rise = (
        gap + (0.016 - gap) * np.clip((x - PLACE) / (TIP - 0.01 - PLACE), 0, None) ** 2
    )
    rise += (HEIGHT - gap) * (np.clip(PLACE - x, 0, None) / (PLACE - GRIPPER.x)) ** 3
    return np.vstack([fold, np.stack([x, rise], axis=1)])


def _measured(k: int, gap: float, profile: Array | None = None) -> StripMeasurement:
    """The measurement of image `k` at 60 Hz."""
    points = _profile(gap) if profile is None else profile
    return StripMeasurement(k / 60, k, 0.3, 1.0, points, 1.0, (TIP, 0.008), gap, PLACE)


def _watch(
    gap: Callable[[float], float],
    strip: StripFile = DENIM,
    *,
    frames: int = 60,
    skip: set[int] | None = None,
) -> tuple[SeenTouch | None, float]:
    """The touch told for gap(t) at 60 Hz, and when it was told."""
    detector = LayerTouch(strip)
    for k in range(frames):
        if skip and k in skip:
            continue
        touch = detector.update(_measured(k, gap(k / 60)), GRIPPER)
        if touch is not None:
            return touch, k / 60
    return None, float("nan")


def _closing(speed: float, at: float, rest: float = 0.0009) -> Callable[[float], float]:
    return lambda t: max(0.001 + speed * (at - t), rest)


def test_one_image_that_is_misread_at_the_touch_moves_no_length() -> None:
    lengths = []
    for stray in (0.0, 0.005):
        detector, touch = LayerTouch(DENIM), None
        for k in range(60):
            gap = _closing(0.3, 0.5)(k / 60)
            profile = _profile(gap)
            profile[60:140:2, 1] += stray * (k == 30)
            touch = touch or detector.update(_measured(k, gap, profile), GRIPPER)
        lengths.append(touch.to_grasped)
    assert lengths[1] == pytest.approx(lengths[0], abs=2e-4)


@pytest.mark.parametrize("speed", [0.01, 0.05, 0.3])
def test_touch_is_told_at_its_time_with_its_lengths(speed: float) -> None:
    touch, told = _watch(_closing(speed, 0.6))
    assert touch.time == pytest.approx(0.6, abs=0.012)
    assert told - 0.6 < 0.12
    assert touch.to_fixed == pytest.approx(PLACE, abs=1e-6)
    upper = _profile(0.001)
    upper = upper[(upper[:, 0] <= PLACE) & (np.arange(len(upper)) > 30)]
    length = np.hypot(*np.diff(np.vstack([[(PLACE, 0.001)], upper]), axis=0).T).sum()
    assert touch.to_grasped == pytest.approx(length, abs=0.001)
    assert touch.confidence > 0.7


@pytest.mark.parametrize(
    "gap",
    [
        _closing(0.05, 0.5, rest=0.003),
        lambda t: 0.0012 + 0.2 * abs(t - 0.5),
        lambda t: 0.03 + 0.08 * (0.5 - t) if t < 0.5 else 0.0,
        lambda _: 0.0009,
        lambda _: float("nan"),
    ],
    ids=["rests above", "only dips", "jumps shut", "never apart", "never seen"],
)
def test_gap_that_does_not_close_and_stop_is_no_touch(
    gap: Callable[[float], float],
) -> None:
    assert _watch(gap)[0] is None


@pytest.mark.parametrize(
    ("longer", "fold"), [(0.29, True), (0.31, False), (-0.31, False)]
)
def test_layers_that_differ_by_half_the_strip_are_no_fold(
    longer: float, fold: bool
) -> None:
    touch = SeenTouch(1.0, 0.3, 0.3 + longer, 0.3, confidence=1.0, distance=0.001)
    assert LayerTouch(DENIM)._is_a_fold(touch) is fold


def test_layers_of_unknown_thickness_touch_where_their_gap_stays() -> None:
    unknown = DENIM.model_copy(update={"spread": {"thickness": (0.0002, 0.003)}})
    touch, _ = _watch(_closing(0.05, 0.5, rest=0.0022), unknown)
    assert touch.distance == pytest.approx(0.0022)
    assert touch.time == pytest.approx(0.5 - 0.0012 / 0.05, abs=0.012)
    assert _watch(_closing(0.05, 0.5, rest=0.005), unknown)[0] is None


def test_noise_of_a_tenth_of_a_millimetre_moves_the_touch_by_less_than_20_ms() -> None:
    rng = np.random.default_rng(0)
    for _ in range(10):
        noise = iter(0.0001 * rng.normal(size=100))
        touch, _ = _watch(lambda t: _closing(0.05, 0.6)(t) + next(noise))  # noqa: B023
        assert touch.time == pytest.approx(0.6, abs=0.02)


def test_lost_images_delay_the_telling_not_the_time() -> None:
    touch, told = _watch(_closing(0.05, 0.6), skip={36, 37, 38})
    assert touch.time == pytest.approx(0.6, abs=0.02)
    assert told > 0.65


@pytest.mark.parametrize(("rest", "rests"), [(0.0025, True), (0.0009, False)])
def test_layers_that_rest_farther_apart_than_the_strip_is_thick_are_no_touch_and_said(
    rest: float, rests: bool
) -> None:
    detector = LayerTouch(DENIM)
    for k in range(30):  # they close until now
        detector.update(_measured(k, 0.001 + 0.05 * (0.6 - k / 60)), GRIPPER)
    assert np.isnan(detector.resting())
    for k in range(30, 60):
        touch = detector.update(
            _measured(k, _closing(0.05, 0.6, rest)(k / 60)), GRIPPER
        )
    assert (touch is None) == rests
    assert np.isfinite(detector.resting()) == rests
