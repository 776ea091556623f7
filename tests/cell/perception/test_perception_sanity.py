"""Images that are old, or repeat themselves while the gripper moves, are noticed."""

import numpy as np

from cell.perception.camera_watch import ImageSanity
from drivers.types import Frame, Pose

HERE = Pose(0.6, 0.1, 0.0)


def _frame(sequence: int, level: int) -> Frame:
    image = np.full((8, 8, 3), level, np.uint8)
    return Frame(sequence / 60, sequence / 60 + 0.02, "test", sequence, image)


def _counts(poses: list[Pose], levels: list[int]) -> list[int]:
    sanity = ImageSanity()
    told = enumerate(zip(poses, levels, strict=True))
    return [sanity.update(_frame(k, level), k / 60, pose).identical for k, (pose, level) in told]


def _path(step: float, count: int) -> list[Pose]:
    return [Pose(0.6 - k * step, 0.1, 0.0) for k in range(count)]


def test_age_is_from_the_stamp_not_the_arrival() -> None:
    health = ImageSanity().update(_frame(6, 1), 0.15, HERE)
    assert abs(health.age - 0.05) < 1e-9


def test_images_that_repeat_while_the_gripper_moves_are_counted() -> None:
    assert _counts(_path(0.003, 5), [7] * 5) == [1, 2, 3, 4, 5]


def test_equal_images_of_a_scene_at_rest_are_no_frozen_camera() -> None:
    assert _counts([HERE] * 200, [7] * 200) == [1] * 200


def test_what_the_arm_measures_at_rest_is_no_motion() -> None:
    rng = np.random.default_rng(0)
    poses = [Pose(0.6 + x, 0.1 + z, p) for x, z, p in rng.normal(0, 2e-5, (200, 3))]
    assert _counts(poses, [7] * 200) == [1] * 200


def test_slow_gripper_before_a_frozen_camera_is_noticed_once_it_is_elsewhere() -> None:
    counts = _counts(_path(0.0001, 60), [7] * 60)
    assert counts[18] == 1
    assert counts[25] >= 4


def test_turning_gripper_before_a_frozen_camera_is_noticed() -> None:
    poses = [Pose(0.6, 0.1, 0.05 * k) for k in range(6)]
    assert _counts(poses, [7] * 6)[-1] >= 4


def test_one_changed_byte_is_a_fresh_image_however_far_the_gripper_moved() -> None:
    sanity = ImageSanity()
    sanity.update(_frame(0, 7), 0.0, HERE)
    changed = _frame(1, 7)
    changed.image[3, 3, 1] += 1
    assert sanity.update(changed, 0.02, Pose(0.5, 0.1, 0.0)).identical == 1


def test_gripper_that_moved_before_the_image_froze_does_not_count() -> None:
    poses = [Pose(0.6, 0.1, 0.0), Pose(0.5, 0.1, 0.0), Pose(0.5, 0.1, 0.0), Pose(0.5, 0.1, 0.0)]
    assert _counts(poses, [1, 7, 7, 7]) == [1, 1, 1, 1]


def test_the_same_frame_told_twice_is_not_a_repetition() -> None:
    sanity = ImageSanity()
    assert sanity.update(_frame(0, 7), 0.0, HERE).identical == 1
    again = sanity.update(_frame(0, 7), 0.1, Pose(0.5, 0.1, 0.0))
    assert again.identical == 1
    assert abs(again.age - 0.1) < 1e-9
