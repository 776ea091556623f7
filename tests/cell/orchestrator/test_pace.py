"""A gap in the images is bridged by waiting; a camera that is gone ends the run."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cell.base.config.settings import MonitorLimits
from cell.orchestrator.monitors import USUAL_AGE, slow_for_images
from cell.orchestrator.snapshot import CloseHand, Drive, Hold, MoveTo
from cell.orchestrator.states import State, Trigger
from cell.orchestrator.steps import move
from drivers.base.types import ZERO_VELOCITY, Frame, Pose, Velocity
from tests.support.plain_cell import FRAME, Bench, phases, plain_bench, showing

LIMITS = MonitorLimits()
AGE, WAIT = LIMITS.image_age, LIMITS.image_wait
BEGIN, DRIVEN = 0.5, 1.8  # s, from when on images are lost: in a move, in a drive
FAST = Velocity(-0.1, 0.05, 0.2)
PLACE = Pose(0.4, 0.1, math.pi / 2)
DRIVE, MOVE = Drive(FAST), MoveTo(PLACE)
STANDS = Drive(ZERO_VELOCITY)
BRAKES = 0.1  # s in which an arm at 0.11 m/s rests


def aged(age: float, state: State = State.FOLD):
    return replace(showing(frame=replace(FRAME, stamp=10 - age)), state=state)


def test_usual_images_change_no_command() -> None:
    for command in (DRIVE, MOVE, Hold()):
        assert slow_for_images(command, aged(0.99 * USUAL_AGE * AGE), LIMITS) == command


@pytest.mark.parametrize("state", [State.LIFT, State.FOLD, State.LAY])
def test_drive_slows_down_in_proportion_and_stands_at_the_limit(state: State) -> None:
    middle = slow_for_images(DRIVE, aged((1.0 + USUAL_AGE) / 2 * AGE, state), LIMITS)
    assert isinstance(middle, Drive)
    assert middle.velocity.vx == pytest.approx(FAST.vx / 2)
    assert middle.velocity.pitch_rate == pytest.approx(FAST.pitch_rate / 2)
    stands = slow_for_images(DRIVE, aged(1.1 * AGE, state), LIMITS)
    assert stands == STANDS


def test_move_is_held_at_the_limit_and_fingers_are_not() -> None:
    old = aged(1.1 * AGE, State.GRASP)
    assert slow_for_images(MOVE, old, LIMITS) == Hold()
    assert slow_for_images(CloseHand(), old, LIMITS) == CloseHand()


def test_move_is_held_while_the_newest_image_repeats_the_one_before() -> None:
    assert slow_for_images(MOVE, showing(identical=2), LIMITS) == Hold()


def test_where_no_image_is_needed_their_age_does_not_count() -> None:
    assert slow_for_images(MOVE, aged(9.0, State.PREFLIGHT), LIMITS) == MoveTo(PLACE)


def drives(*_):
    for _ in range(200):
        yield DRIVE
    return Trigger.PATH_DONE


def moves(*_):
    yield from move(PLACE)
    return Trigger.LIFTED


@pytest.fixture
def bench() -> Bench:
    return replace(plain_bench(), phases=phases(LIFT=moves, FOLD=drives))


def lose_images(bench: Bench, begin: float, seconds: float) -> None:
    read = bench.camera.read

    def losing(after: float, timeout: float) -> Frame | None:
        lost = begin <= bench.now < begin + seconds
        return None if lost else read(after, timeout)

    bench.camera.read = losing


@pytest.mark.parametrize("begin", [BEGIN, DRIVEN], ids=["moved", "driven"])
def test_gap_is_waited_for_at_rest_and_the_run_goes_on(bench, begin: float) -> None:
    rested: list[bool] = []
    lose_images(bench, begin, AGE + 0.9 * WAIT)
    bench.observers = (Watch(bench, rested),)
    assert bench.run().name == "path_done"
    assert rested
    assert all(rested)


def test_camera_that_is_gone_ends_the_run_with_an_arm_that_already_stands(
    bench,
) -> None:
    rested: list[bool] = []
    lose_images(bench, DRIVEN, 60.0)
    bench.observers = (Watch(bench, rested),)
    outcome = bench.run()
    assert outcome.name == "image_stale"
    assert "waited" in outcome.reason
    assert rested[-1]
    ended = bench.now - DRIVEN - AGE
    assert 0.0 < ended < WAIT + 0.5
    assert bench.at_rest


def test_images_that_are_always_too_old_end_the_run(bench) -> None:
    read = bench.camera.read

    def late(after: float, timeout: float) -> Frame | None:
        frame = read(-1.0, timeout)
        if frame is None or bench.now < BEGIN:
            return frame
        return replace(frame, stamp=bench.now - 1.2 * AGE)

    bench.camera.read = late
    assert bench.run().name == "image_stale"
    assert bench.now < BEGIN + 1.0


class Watch:
    """Notes on each tick whether the arm rests while the newest image is too old."""

    def __init__(self, bench: Bench, rested: list[bool]) -> None:
        self._bench, self._rested = bench, rested

    def handle_tick(self, snapshot) -> None:
        stale_since = snapshot.view.stale_since
        if stale_since is not None:
            waited = snapshot.time - stale_since
            if waited >= BRAKES:
                self._rested.append(self._bench.at_rest)

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """No event counts."""


@pytest.mark.parametrize("doubt", [{"doubtful_since": 9.99}, {"moved": 1}])
def test_image_that_cannot_be_read_does_not_hold_the_arm(doubt) -> None:
    assert slow_for_images(DRIVE, showing(**doubt), LIMITS) == DRIVE


def show(bench: Bench, content: Callable[[int], int]) -> None:
    """Twenty images a second, the n-th of the drive as grey as `content` of n says."""
    read = bench.camera.read
    shown: list[Frame] = []

    def showing(after: float, timeout: float) -> Frame | None:
        frame = read(after, timeout)
        if frame is None or bench.now < DRIVEN:
            return frame
        if shown and frame.stamp < shown[-1].stamp + 0.0499:
            return None
        shown.append(
            replace(frame, image=np.full((2, 2, 3), content(len(shown)), np.uint8))
        )
        return shown[-1]

    bench.camera.read = showing


def test_image_sent_twice_makes_the_arm_wait_and_ends_no_run(bench) -> None:
    show(bench, lambda number: number // 2)
    assert bench.run().name == "path_done"
    assert STANDS in bench.arm.commands


def test_arm_of_a_frozen_camera_stands_before_the_fault_is_named(bench) -> None:
    show(bench, lambda number: min(number, 10))
    assert bench.run().name == "image_frozen"
    sent = [command for command in bench.arm.commands if isinstance(command, Drive)]
    assert sent[-4:] == [STANDS] * 4
