"""Phase of a run that calibrates the camera's homography: touches, latency steps, landmarks."""

from collections.abc import Generator
from dataclasses import replace

from calibration.homography import Homography
from calibration.landmarks import take_landmarks
from calibration.wizard.latency import LatencySteps, latency_verdict
from cell.orchestrator import steps
from cell.orchestrator.context import CalibrationContext
from cell.orchestrator.operator import Answer, Ask, Question
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.snapshot import Command, Hold, MoveTo, Snapshot
from cell.orchestrator.states import Event, State
from drivers.arm.obstacles import require_clear
from drivers.errors import CellError
from drivers.types import Pose

Doing = Generator[Command, Snapshot, None]
Answering = Generator[Command, Snapshot, Answer]

POINTER_IN = Question(Ask.POINTER_IN, "put the pointer between the fingers, its disc to the camera")
STEPS_QUESTION = Question(Ask.STEPS, "the arm now steps to and fro to measure the camera's latency")
POINTER_OUT = Question(Ask.POINTER_OUT, "take the pointer out and keep clear of the hand")
STEP_REST = 0.3  # s at rest after a step of the latency measurement


def begin_calibration(_context: CalibrationContext, _: Recorder, _begin: Snapshot) -> steps.Phase:
    """Start the calibration at once, as there is no strip to check beforehand."""
    yield from steps.pause(0.0)
    return Event.NEEDS_CALIBRATION


def calibrate(context: CalibrationContext, record: Recorder, begin: Snapshot) -> steps.Phase:
    """Touch all points; where a homography is fitted, measure latency and landmarks too."""
    points = context.points
    first = replace(begin.arm.commanded, pitch=points.plan[0].pitch)
    require_clear([begin.arm.commanded, first, *points.plan], context.desk)
    yield from steps.open_hand()
    yield from _wait_for_answer(context, POINTER_IN)
    yield from steps.close_hand()
    yield from steps.rotate_hand(points.plan[0].pitch)
    yield from _touch_all(context, record)
    if not points.fitted:
        yield from steps.open_hand()
        yield from _wait_for_answer(context, POINTER_OUT)
        return Event.CALIBRATED
    context.touches = points.verdict()
    if context.touches.homography is not None:
        yield from _measure_latency(context, context.touches.homography)
        if context.remembers:
            yield from _take_landmarks(context, context.touches.homography)
    return Event.CALIBRATED


def _touch_all(context: CalibrationContext, record: Recorder) -> Doing:
    """Touch every requested pose, and once more each point that disagrees with the others."""
    points = context.points
    while (pose := points.ask()) is not None:
        stage = "touch again" if points.again else "touch"
        progress = points.progress(pose, points.why, stage)
        context.watch(progress)
        answer = yield from _wait_for_answer(context, Question(Ask.TOUCH, points.why))
        if answer is Answer.SKIP:
            points.skip()
        elif answer is Answer.AGAIN:
            context.watch(replace(progress, taken_back=points.take_back()))
        else:
            yield from steps.move(pose)
            yield from _measure_point(context, record, pose, points.why, stage)


def _measure_point(
    context: CalibrationContext, record: Recorder, pose: Pose, why: str, stage: str
) -> Doing:
    """Take images at rest at `pose` until its point is accepted or given up.

    Each result goes to the observers, with the reason `why` for the pose and the `stage` of the
    calibration, and a refusal into the record.
    """
    points = context.points
    result = None
    while result is None or not (result.taken or result.given_up):
        settle = result is None or result.refused is not None
        picture = yield from steps.still_picture(settle=settle)
        result = points.tell(picture.frame, picture.gripper)
        answer = points.answer(result, picture.gripper)
        progress = points.progress(pose, why, stage)
        context.watch(replace(progress, frame=picture.frame, result=result, answer=answer))
        if result.refused is not None:
            record.event(picture.time, "touch_refused", reason=result.refused)


def _measure_latency(context: CalibrationContext, homography: Homography) -> Doing:
    """Step the arm back and forth, and measure how late the images show it."""
    yield from _wait_for_answer(context, STEPS_QUESTION)
    latency_steps = LatencySteps(context.settings.latency)
    while (pose := latency_steps.ask()) is not None:
        why = f"{latency_steps.left} steps are left, to see how late the images are"
        context.watch(context.points.progress(pose, why, "latency"))
        yield from _step(latency_steps, pose)
        latency_steps.record_arrival()
    context.watch(replace(context.points.progress(None, "seen", "latency"), steps=latency_steps))
    seen = latency_steps.seen
    settings = context.settings.latency
    context.latency = latency_verdict(
        latency_steps.arm, seen, context.points.lens, homography, settings
    )


def _step(latency_steps: LatencySteps, pose: Pose) -> Doing:
    """Move to `pose` and rest there briefly; `latency_steps` gets every arm state and image."""
    arrived: float | None = None
    snapshot = yield MoveTo(pose)
    while arrived is None or snapshot.time < arrived + STEP_REST:
        snapshot = yield MoveTo(pose)
        latency_steps.tell_arm(snapshot.arm)
        if snapshot.view.fresh and snapshot.view.frame is not None:
            latency_steps.tell_frame(snapshot.view.frame)
        if arrived is None and steps.is_at(snapshot, pose):
            arrived = snapshot.time


def _take_landmarks(context: CalibrationContext, homography: Homography) -> Doing:
    """Store landmarks from an image of the empty hand; none where no finger tip is visible."""
    yield from steps.open_hand()
    yield from _wait_for_answer(context, POINTER_OUT)
    pose = context.settings.landmarks.pose
    why = "the empty hand here shows later whether the camera moved"
    context.watch(context.points.progress(pose, why, "remember"))
    yield from steps.move(pose)
    picture = yield from steps.still_picture()
    try:
        context.landmarks = take_landmarks(
            picture.frame, picture.gripper, context.points.lens, homography
        )
    except CellError as error:
        context.watch(context.points.progress(pose, str(error), "remember"))


def _wait_for_answer(context: CalibrationContext, question: Question) -> Answering:
    """Hold the arm until the operator has answered."""
    while (answer := context.operator.answer(question)) is None:
        yield Hold()
    yield Hold()
    return answer


CALIBRATION_PHASES = {State.PREFLIGHT: begin_calibration, State.CALIBRATE: calibrate}
