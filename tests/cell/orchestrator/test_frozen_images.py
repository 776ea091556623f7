"""Images that repeat themselves while the gripper moves are noticed."""

import numpy as np
import pytest

from cell.orchestrator.vision import FrozenImages
from drivers.base.types import Frame, Pose

HERE = Pose(0.6, 0.1, 0.0)
NOISE = np.random.default_rng(0).normal(0, 2e-5, (200, 3))


def _frame(sequence: int, level: int) -> Frame:
    image = np.full((8, 8, 3), level, np.uint8)
    return Frame(sequence / 60, sequence / 60 + 0.02, "test", sequence, image)


def _counts(poses: list[Pose], levels: list[int]) -> list[int]:
    frozen, told = FrozenImages(), enumerate(zip(poses, levels, strict=True))
    return [frozen.count(_frame(k, level), pose) for k, (pose, level) in told]


def _path(step: float, count: int) -> list[Pose]:
    return [Pose(0.6 - k * step, 0.1, 0.0) for k in range(count)]


def test_images_that_repeat_while_the_gripper_moves_are_counted() -> None:
    assert _counts(_path(0.003, 5), [7] * 5) == [1, 2, 3, 4, 5]
    turning = [Pose(0.6, 0.1, 0.1 * k) for k in range(5)]
    assert _counts(turning, [7] * 5) == [1, 2, 3, 4, 5]
    frozen = FrozenImages()  # of a camera that does not number them
    assert [frozen.count(_frame(0, 7), pose) for pose in _path(0.003, 3)] == [1, 2, 3]


@pytest.mark.parametrize(
    "poses",
    [
        [HERE] * 200,
        # as an arm measures it
        [Pose(0.6 + x, 0.1 + z, pitch) for x, z, pitch in NOISE],
        [HERE, *[Pose(0.5, 0.1, 0.0)] * 3],  # it moved before the image froze
    ],
    ids=["at rest", "noise", "before"],
)
def test_equal_images_of_a_scene_at_rest_are_no_frozen_camera(
    poses: list[Pose],
) -> None:
    levels = [7] * len(poses) if len(poses) > 4 else [1, 7, 7, 7]
    assert _counts(poses, levels) == [1] * len(poses)


def test_slow_gripper_before_a_frozen_camera_is_noticed_once_it_is_elsewhere() -> None:
    counts = _counts(_path(0.0001, 60), [7] * 60)
    assert counts[18] == 1
    assert counts[25] >= 4


def test_one_changed_byte_is_a_fresh_image_however_far_the_gripper_moved() -> None:
    frozen, changed = FrozenImages(), _frame(1, 7)
    frozen.count(_frame(0, 7), HERE)
    changed.image[3, 3, 1] += 1
    assert frozen.count(changed, Pose(0.5, 0.1, 0.0)) == 1
