"""Where no arm reports it, the held end follows from the strip's length and where it
was.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from cell.perception import held_end
from cell.perception.held_end import HeldEnd
from cell.perception.strip_measurement import StripMeasurement
from drivers.base.types import Pose

LENGTH, CONTACT, NEAR = 0.6, 0.3, 0.02  # m; the fingers hide NEAR of the strip
WAY = [(0.585, 0.03, 0.4), (0.565, 0.05, 0.8), (0.54, 0.07, 1.2), (0.515, 0.09, 1.5)]


class Hanging:
    """Sees a strip that rises to `end`, if it looks within 35 mm of that."""

    sure = 1.0

    def __init__(self, *_: object) -> None:
        self.guesses: list[Pose] = []

    def measure(self, end: SimpleNamespace, guess: Pose) -> StripMeasurement:
        self.guesses.append(guess)
        seen = np.hypot(guess.x - end.x, guess.z - end.z) < 0.035
        slope = np.array([np.cos(end.pitch), np.sin(end.pitch)])
        shares = np.linspace(LENGTH - CONTACT, NEAR, 100 if seen else 0)[:, None]
        curve = (end.x, end.z) - shares * slope
        return StripMeasurement(
            end.stamp, 0, CONTACT, 1.0, curve, self.sure * seen, (0, 0), 0.0, 0.0
        )


@pytest.fixture
def followed(monkeypatch) -> tuple[HeldEnd, Hanging]:
    monkeypatch.setattr(held_end, "Perception", Hanging)
    strip = SimpleNamespace(length=LENGTH)
    found = HeldEnd(None, strip, None)
    return found, found._perception


def test_held_end_is_followed_from_the_lift_on(followed) -> None:
    follow, images = followed
    for count, place in enumerate(WAY):
        found = follow.measure(SimpleNamespace(stamp=0.1 * count, **pose(place)))
        assert found.end.as_array() == pytest.approx(place, abs=1e-6)
        assert found.measurement.gripper == pytest.approx(place[:2], abs=1e-6)
    assert images.guesses[-1].as_array() == pytest.approx((0.515, 0.09, 1.2), abs=1e-6)


def test_end_that_is_not_where_it_should_be_is_looked_for_nearby(followed) -> None:
    follow, _ = followed
    for count, place in enumerate([*WAY[:3], (0.56, 0.1, 1.5)]):
        found = follow.measure(SimpleNamespace(stamp=0.1 * count, **pose(place)))
    assert found.end.as_array() == pytest.approx((0.56, 0.1, 1.5), abs=1e-6)
    lost = follow.measure(SimpleNamespace(stamp=0.5, **pose((0.1, 0.4, 1.5))))
    assert lost.end is None
    assert lost.measurement.confidence == 0.0


def pose(place: tuple[float, float, float]) -> dict[str, float]:
    return dict(zip(("x", "z", "pitch"), place, strict=True))


def test_an_end_that_is_hardly_seen_is_none(followed) -> None:
    follow, images = followed
    images.sure = 0.2
    found = follow.measure(SimpleNamespace(stamp=0.0, **pose(WAY[0])))
    assert found.end is None
    assert found.measurement.confidence == 0.2
