"""What every camera must do, simulated or real."""

import math
from itertools import pairwise

import numpy as np
import pytest

from drivers.base.errors import Fault

LOOK = 0.005  # s
ALWAYS = -math.inf


@pytest.fixture
def bench(camera_bench):
    return camera_bench


@pytest.fixture
def camera(bench):
    bench.camera.connect()
    return bench.camera


def watch(bench, camera, seconds: float) -> list:
    """Every frame of the next `seconds`, read as soon as it is there."""
    clock = bench.clock
    seen, after = [], ALWAYS
    end = clock.now() + seconds
    while clock.now() < end:
        clock.wait_until(clock.now() + LOOK)
        frame = camera.read(after, 0.0)
        if frame is not None:
            seen.append((clock.now(), frame))
            after = frame.stamp
    return seen


def test_camera_refuses_to_read_until_it_is_connected(bench) -> None:
    with pytest.raises(Fault):
        bench.camera.read(ALWAYS, 0.0)


def test_nothing_is_seen_before_the_first_frame_arrives(bench, camera) -> None:
    assert camera.read(ALWAYS, 0.0) is None


def test_frames_arrive_in_order_each_known_after_it_was_exposed(bench, camera) -> None:
    seen = watch(bench, camera, 0.4)
    assert len(seen) >= 5
    for now, frame in seen:
        assert frame.stamp < frame.arrival <= now
        assert frame.source
    stamps = [frame.stamp for _, frame in seen]
    sequences = [frame.sequence for _, frame in seen]
    assert all(a < b for a, b in pairwise(stamps))
    assert all(a < b for a, b in pairwise(sequences))


def test_images_are_colour_and_of_one_size(bench, camera) -> None:
    images = [frame.image for _, frame in watch(bench, camera, 0.15)]
    assert {image.shape for image in images} == {images[0].shape}
    assert images[0].ndim == 3
    assert images[0].shape[2] == 3
    assert all(image.dtype == np.uint8 for image in images)


def test_read_gives_the_newest_frame_and_skips_those_between(bench, camera) -> None:
    (_, first), *_ = watch(bench, camera, 0.1)
    bench.clock.wait_until(bench.clock.now() + 0.2)
    newest = camera.read(first.stamp, 0.0)
    assert newest.sequence > first.sequence + 1
    assert bench.clock.now() - newest.stamp < 0.1
    assert camera.read(newest.stamp, 0.0) is None


def test_looking_takes_no_time(bench, camera) -> None:
    watch(bench, camera, 0.1)
    before = bench.clock.now()
    camera.read(ALWAYS, 0.0)
    assert bench.clock.now() - before < LOOK


def test_reading_twice_gives_the_same_picture(bench, camera) -> None:
    watch(bench, camera, 0.1)
    first, second = camera.read(ALWAYS, 0.0), camera.read(ALWAYS, 0.0)
    assert first.sequence != second.sequence or np.array_equal(
        first.image, second.image
    )


def test_two_frames_of_a_still_scene_differ_by_noise(bench, camera) -> None:
    frames = [frame for _, frame in watch(bench, camera, 0.15)]
    assert not np.array_equal(frames[0].image, frames[1].image)


def test_closed_camera_refuses_to_read_and_closes_twice(bench, camera) -> None:
    camera.close()
    camera.close()
    with pytest.raises(Fault):
        camera.read(ALWAYS, 0.0)
