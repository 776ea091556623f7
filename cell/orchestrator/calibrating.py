"""Phase of a run that calibrates the homography: touches, latency steps, landmarks."""

from collections.abc import Generator
from dataclasses import replace

from calibration.landmarks import remember
from calibration.wizard.latency import LatencySteps
from calibration.wizard.news import Stage, TouchNews
from calibration.wizard.touch_verdict import check_verdict
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import check_plan
from cell.orchestrator.context import CalibrationContext
from cell.orchestrator.operator import Answer, Ask, Question
from cell.orchestrator.recorder import Record
from cell.orchestrator.snapshot import Command, Hold, MoveTo, Snapshot
from cell.orchestrator.states import Event
from cell.orchestrator.steps import (
    Phase,
    close_hand,
    is_at,
    move,
    open_hand,
    pause,
    still_picture,
    turn,
)
from drivers.arm.clearance import require_clear
from drivers.errors import CellError
from drivers.types import Pose

Doing = Generator[Command, Snapshot, None]
Answering = Generator[Command, Snapshot, Answer]

POINTER_IN = Question(Ask.POINTER_IN, "put the pointer between the fingers, its disc to the camera")
STEPS_QUESTION = Question(Ask.STEPS, "the arm now steps to and fro to measure the camera's latency")
POINTER_OUT = Question(Ask.POINTER_OUT, "take the pointer out and keep clear of the hand")
STEP_REST = 0.3  # s at rest after a step of the latency measurement


def go_calibrate(_cell: CalibrationContext, _record: Record, _begin: Snapshot) -> Phase:
    """Phase that leads to calibration directly, without a check of a strip."""
    yield from pause(0.0)
    return Event.NEEDS_CALIBRATION


def calibrate(cell: CalibrationContext, record: Record, begin: Snapshot) -> Phase:
    """Phase that measures homography, latency and landmarks, or checks an old calibration."""
    points = _make_points(cell)
    first = replace(begin.arm.commanded, pitch=points.plan[0].pitch)
    require_clear([first, *points.plan], cell.desk)
    yield from open_hand()
    yield from _wait_for_answer(cell, POINTER_IN)
    yield from close_hand()
    yield from turn(points.plan[0].pitch)
    yield from _touch_all(cell, points, record)
    if cell.old is not None:
        cell.check = check_verdict(points.touches, cell.old, cell.settings.touches)
        yield from open_hand()
        yield from _wait_for_answer(cell, POINTER_OUT)
        return Event.CALIBRATED
    cell.touches = points.verdict()
    if cell.touches.homography is not None:
        yield from _measure_latency(cell, points)
    if cell.touches.homography is not None and cell.remembers:
        yield from _take_landmarks(cell, points)
    return Event.CALIBRATED


def _make_points(cell: CalibrationContext) -> TouchedPoints:
    """Points to touch: those to be fitted, or the few that check an old calibration."""
    settings = cell.settings.touches
    if cell.old is None:
        return TouchedPoints(cell.lens, settings, cell.plan)
    return TouchedPoints(cell.lens, settings, cell.plan or check_plan(settings), fitted=False)


def _touch_all(cell: CalibrationContext, points: TouchedPoints, record: Record) -> Doing:
    """Touch every requested pose, and once more each point that disagrees with the others."""
    while (pose := points.ask()) is not None:
        why = _reason(points)
        cell.watch(_news(points, pose, why))
        answer = yield from _wait_for_answer(cell, Question(Ask.TOUCH, why))
        if answer is Answer.SKIP:
            points.skip()
        elif answer is Answer.AGAIN:
            cell.watch(replace(_news(points, pose, why), dropped=points.repeat()))
        else:
            yield from move(pose)
            yield from _touch(cell, points, record, why)


def _touch(cell: CalibrationContext, points: TouchedPoints, record: Record, why: str) -> Doing:
    """Take images at rest until the point is accepted or given up."""
    number, again, wanted = points.number, points.again, points.ask()
    settle = True
    while (points.number, points.again) == (number, again):
        picture = yield from still_picture(settle=settle)
        result = points.tell(picture.frame, picture.gripper)
        settle = result.refused is not None
        news = _news(points, wanted, why, Stage.AGAIN if again else Stage.TOUCH)
        cell.watch(replace(news, frame=picture.frame, pose=picture.gripper, result=result))
        if result.refused is not None:
            record.event(picture.time, "touch_refused", reason=result.refused)


def _measure_latency(cell: CalibrationContext, points: TouchedPoints) -> Doing:
    """Step the arm back and forth, and measure how late the images show it."""
    yield from _wait_for_answer(cell, STEPS_QUESTION)
    steps = LatencySteps(cell.settings.latency)
    while (pose := steps.ask()) is not None:
        why = f"{steps.left} steps are left, to see how late the images are"
        cell.watch(_news(points, pose, why, Stage.LATENCY))
        yield from _step(steps, pose)
        steps.record_arrival()
    cell.watch(replace(_news(points, None, "seen", Stage.LATENCY), steps=steps))
    if cell.touches is not None and cell.touches.homography is not None:
        cell.latency = steps.verdict(cell.lens, cell.touches.homography)


def _step(steps: LatencySteps, pose: Pose) -> Doing:
    """Move to `pose` and rest there briefly, passing every arm state and image to `steps`."""
    arrived: float | None = None
    snapshot = yield MoveTo(pose)
    while arrived is None or snapshot.time < arrived + STEP_REST:
        snapshot = yield MoveTo(pose)
        steps.tell_arm(snapshot.arm)
        if snapshot.view.fresh and snapshot.view.frame is not None:
            steps.tell_frame(snapshot.view.frame)
        if arrived is None and is_at(snapshot, pose):
            arrived = snapshot.time


def _take_landmarks(cell: CalibrationContext, points: TouchedPoints) -> Doing:
    """Record landmarks from an image of the empty hand; none where no finger tip is visible."""
    yield from open_hand()
    yield from _wait_for_answer(cell, POINTER_OUT)
    pose = cell.settings.landmarks.pose
    why = "the empty hand here shows later whether the camera moved"
    cell.watch(_news(points, pose, why, Stage.REMEMBER))
    yield from move(pose)
    picture = yield from still_picture()
    if cell.touches is None or cell.touches.homography is None:
        return
    try:
        cell.landmarks = remember(
            picture.frame, picture.gripper, cell.lens, cell.touches.homography
        )
    except CellError as error:
        cell.watch(_news(points, pose, str(error), Stage.REMEMBER))


def _wait_for_answer(cell: CalibrationContext, question: Question) -> Answering:
    """Hold the arm until the operator has answered."""
    while (answer := cell.operator.answer(question)) is None:
        yield Hold()
    yield Hold()
    return answer


def _reason(points: TouchedPoints) -> str:
    if points.again:
        return f"point {points.number} disagrees with the others: touch it once more"
    done = f"{len(points.touches)} of {len(points.plan)} points are touched"
    part = "held out, it decides" if points.held_out else "fitted"
    return f"point {points.number} ({part}): {done}" if points.fitted else done


def _news(
    points: TouchedPoints, wanted: Pose | None, why: str, stage: Stage | None = None
) -> TouchNews:
    stage = stage or (Stage.AGAIN if points.again else Stage.TOUCH)
    return TouchNews(stage, points.plan, points.touches, wanted, why)
