"""Phase of a run that calibrates the camera's homography: touches, latency steps,
landmarks.
"""

from collections.abc import Generator
from dataclasses import replace

from calibration.homography import PlaneMap
from calibration.view import Landmarks
from calibration.wizard.latency import LatencySteps, step_poses
from calibration.wizard.progress import Progress
from calibration.wizard.touched_points import TITLE, request_text
from cell.orchestrator import steps
from cell.orchestrator.context import CalibrationInputs, CalibrationLog
from cell.orchestrator.operator import Answer, Question
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.snapshot import Command, Hold, MoveTo, Snapshot
from cell.orchestrator.states import State, Trigger
from cell.perception.preflight import has_tip
from drivers.base.types import Pose
from drivers.franka.obstacles import require_clear

Doing = Generator[Command, Snapshot, None]
Answering = Generator[Command, Snapshot, Answer]

POINTER_IN = Question(
    "put the pointer between the fingers, its disc to the camera", reaches=True
)
STEPS_QUESTION = Question(
    "the arm now steps to and fro to measure the camera's latency"
)
POINTER_OUT = Question("take the pointer out and keep clear of the hand", reaches=True)
STEP_REST = 0.3  # s at rest after a step of the latency measurement


def begin_calibration(
    _given: CalibrationInputs, _log: CalibrationLog, _: Recorder, _begin: Snapshot
) -> steps.Phase:
    """Begin the calibration without a preflight, as no strip lies on the desk that
    could be checked.
    """
    yield from steps.pause(0.0)
    return Trigger.NEEDS_CALIBRATION


def calibrate(
    given: CalibrationInputs, log: CalibrationLog, record: Recorder, begin: Snapshot
) -> steps.Phase:
    """Touch all calibration points; where a homography is to be fitted, measure the
    camera's latency and store landmarks too.
    """
    points = given.points
    first = replace(begin.arm.commanded, pitch=points.plan[0].pitch)
    require_clear([begin.arm.commanded, first, *points.plan], given.desk_end)
    yield from _hand_over(given, POINTER_IN)
    yield from steps.close_hand()
    yield from steps.rotate_hand(points.plan[0].pitch)
    yield from _touch_all(given, record)
    plane_map = points.verdict().plane_map if points.fitted else None
    if plane_map is not None:
        yield from _measure_latency(given, log.steps)
    if given.remembers or not points.fitted:
        yield from _hand_over(given, POINTER_OUT)
    if given.remembers and plane_map is not None:
        yield from _take_landmarks(given, log, plane_map)
    return Trigger.CALIBRATED


def _hand_over(given: CalibrationInputs, question: Question) -> Doing:
    """Open the hand, and wait until the pointer is in it or out, as the `question`
    asks.
    """
    yield from steps.open_hand()
    yield from _wait_for_answer(given, question)
    if given.aids is not None:
        given.aids.hold_pointer(question == POINTER_IN)


def _touch_all(given: CalibrationInputs, record: Recorder) -> Doing:
    """Touch every requested pose, and once more each point that disagrees with the
    others.
    """
    points = given.points
    while (pose := points.ask()) is not None:
        progress = points.progress()
        given.watch(progress)
        answer = yield from _wait_for_answer(given, Question(points.why))
        if answer is Answer.SKIP:
            points.skip()
        elif answer is Answer.AGAIN:
            given.watch(replace(progress, result=points.take_back()))
        else:
            yield from steps.move(pose)
            yield from _measure_point(given, record)


def _measure_point(given: CalibrationInputs, record: Recorder) -> Doing:
    """Take images at rest until the requested point is accepted or given up.

    Each result goes to the observers, and a refusal into the record.
    """
    points = given.points
    requested = (points.number, points.again)
    settling = steps.SETTLE
    while (points.number, points.again) == requested:
        picture = yield from steps.still_picture(settling)
        result = points.tell(picture.frame, picture.gripper)
        given.watch(points.progress(picture.frame, result))
        settling = 0.0 if result.refused is None else steps.SETTLE
        if result.refused is not None:
            record.event(picture.time, "touch_refused", reason=result.refused)


def _measure_latency(given: CalibrationInputs, told: LatencySteps) -> Doing:
    """Step the arm back and forth, and keep its states and the images for the
    latency.
    """
    yield from _wait_for_answer(given, STEPS_QUESTION)
    poses = step_poses(given.settings.latency)
    for done, pose in enumerate(poses):
        why = f"{len(poses) - done} steps are left, to see how late the images are"
        given.watch(_announced(given, "latency", pose, why))
        yield from _step(told, pose)
    given.watch(replace(given.points.progress(), steps=told))


def _announced(given: CalibrationInputs, stage: str, pose: Pose, why: str) -> Progress:
    """Message for the calibration's observers that the arm goes to `pose`, in which
    `stage` and for which reason `why`.
    """
    progress = given.points.progress()
    return replace(
        progress, title=f"{TITLE}: {stage}", request=request_text(pose), why=why
    )


def _step(latency_steps: LatencySteps, pose: Pose) -> Doing:
    """Move to `pose` and rest there briefly; `latency_steps` gets every arm state and
    image.
    """
    arrived: float | None = None
    snapshot = yield MoveTo(pose)
    while arrived is None or snapshot.time < arrived + STEP_REST:
        snapshot = yield MoveTo(pose)
        latency_steps.tell_arm(snapshot.arm)
        if snapshot.view.fresh and snapshot.view.frame is not None:
            latency_steps.tell_frame(snapshot.view.frame)
        if arrived is None and steps.is_at(snapshot, pose):
            arrived = snapshot.time


def _take_landmarks(
    given: CalibrationInputs, log: CalibrationLog, plane_map: PlaneMap
) -> Doing:
    """Store landmarks from an image of the empty hand; store none where no finger tip
    is visible in it.
    """
    pose = given.settings.landmarks.pose
    why = "the empty hand here shows later whether the camera moved"
    given.watch(_announced(given, "remember", pose, why))
    yield from steps.move(pose)
    picture = yield from steps.still_picture()
    if has_tip(picture.frame.image, pose, plane_map):
        log.landmarks = Landmarks.take(picture.frame.image, picture.gripper)
    else:
        where = f"x {pose.x:.2f}, z {pose.z:.2f} m"
        why = f"landmarks: the tip at {where} is not in the image; choose another pose"
        given.watch(_announced(given, "remember", pose, why))


def _wait_for_answer(given: CalibrationInputs, question: Question) -> Answering:
    """Hold the arm until the operator has answered."""
    while (answer := given.operator.answer(question)) is None:
        yield Hold()
    yield Hold()
    return answer


CALIBRATION_PHASES = {State.PREFLIGHT: begin_calibration, State.CALIBRATE: calibrate}
