"""Each spoiled image differs from the good one in the way that its fault says."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.types import Frame, HandState
from tests.lab.faults import failing
from tests.lab.faults.faults import FAULTS

RNG = np.random.default_rng(0)


def frame(sequence: int) -> Frame:
    rows = np.linspace(20, 120, 48)[:, None, None] + RNG.integers(0, 9, (48, 64, 3))
    stamp = sequence / 20
    return Frame(stamp, stamp + 0.02, "made", sequence, rows.astype(np.uint8))


GOOD, NEXT = frame(9), frame(10)


def test_spoiled_frames_are_frozen_dark_bright_tinted_or_noise() -> None:
    assert np.array_equal(failing.freeze(NEXT, GOOD).image, GOOD.image)
    assert failing.freeze(NEXT, GOOD).stamp == NEXT.stamp
    assert failing.darken(NEXT, GOOD).image.mean() < 0.3 * NEXT.image.mean()
    assert failing.overexpose(NEXT, GOOD).image.mean() > 2.0 * NEXT.image.mean()
    blue, _, red = failing.tint(NEXT, GOOD).image.mean(axis=(0, 1))
    assert blue > 1.5 * red
    assert failing.corrupt(NEXT, GOOD).image[24:].std() > 60
    assert np.array_equal(failing.corrupt(NEXT, GOOD).image[:24], GOOD.image[:24])


def test_nine_of_ten_images_get_lost() -> None:
    got = [failing.lose_most(replace(NEXT, sequence=k), GOOD) for k in range(40)]
    assert sum(one is not None for one in got) == 4


def test_a_moved_camera_sees_everything_elsewhere() -> None:
    image = failing.shift((2.0, 0.0))(NEXT, GOOD).image
    np.testing.assert_array_equal(image[:, 2:], NEXT.image[:, :-2])


def test_late_images_keep_their_stamps() -> None:
    spoil = failing.delay(0.4)
    got = [spoil(frame(k), GOOD) for k in range(12)]
    stamps = [None if one is None else one.sequence for one in got]
    assert stamps == [None] * 8 + [0, 1, 2, 3]


@pytest.mark.parametrize("holes", [False, True])
def test_padding_spoils_no_jpeg_and_holes_leave_none_whole_or_another_image(holes) -> None:
    seen = failing.jpeg(holes=holes)(NEXT, GOOD)
    same = seen is not None and np.abs(seen.image.astype(int) - NEXT.image).max() < 60
    assert same is not holes


def test_silent_hand_says_for_ever_what_it_said_last() -> None:
    said = [HandState(t, t, "made", 0.001, grasped=True, moving=False) for t in (1.0, 1.5, 2.0)]
    hand = failing.FailingHand(SimpleNamespace(state=lambda: said.pop(0)))
    assert hand.state().stamp == 1.0
    FAULTS["hand: silent"].strike(SimpleNamespace(cell=SimpleNamespace(hand=hand)))
    assert [hand.state().stamp for _ in range(2)] == [1.5, 1.5]
