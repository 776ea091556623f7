"""Images that are old or repeat themselves are noticed."""

import numpy as np

from calibration.perception.sanity import ImageSanity
from drivers.types import Frame


def _frame(sequence: int, level: int) -> Frame:
    image = np.full((8, 8, 3), level, np.uint8)
    return Frame(sequence / 60, sequence / 60 + 0.02, "test", sequence, image)


def test_age_is_from_the_stamp_not_the_arrival() -> None:
    health = ImageSanity().tell(_frame(6, 1), now=0.15)
    assert abs(health.age - 0.05) < 1e-9


def test_images_that_repeat_byte_for_byte_are_counted() -> None:
    sanity = ImageSanity()
    counts = [sanity.tell(_frame(k, 7), now=k / 60).identical for k in range(4)]
    assert counts == [1, 2, 3, 4]


def test_one_changed_byte_is_a_fresh_image() -> None:
    sanity = ImageSanity()
    sanity.tell(_frame(0, 7), now=0.0)
    changed = _frame(1, 7)
    changed.image[3, 3, 1] += 1
    assert sanity.tell(changed, now=0.02).identical == 1


def test_the_same_frame_told_twice_is_not_a_repetition() -> None:
    sanity = ImageSanity()
    assert sanity.tell(_frame(0, 7), now=0.0).identical == 1
    again = sanity.tell(_frame(0, 7), now=0.1)
    assert again.identical == 1
    assert abs(again.age - 0.1) < 1e-9
