"""Single fold of a strip: devices are opened, the fold is checked, carried out and
recorded.
"""

import gc
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from calibration.calibration import Calibration, save_calibration
from cell.base.config.unmeasured_strip import UNKNOWN_NAME as UNKNOWN
from cell.base.devices.devices import Devices
from cell.base.devices.open import open_cell
from cell.base.devices.rig_correction import corrected_calibration
from cell.folding.correction import Correction, experience_of
from cell.folding.documents import (
    CHECKPOINT_BYTES,
    offer_strip,
    result_content,
    run_header,
)
from cell.folding.experience import run_key
from cell.folding.feasibility import Feasibility, assess
from cell.folding.fold_trace import FoldTrace
from cell.folding.request import Request, memory_of
from cell.folding.result import FoldResult
from cell.orchestrator.context import FoldInputs, FoldLog
from cell.orchestrator.outcome import INTERRUPTED_AT_ONCE, Outcome
from cell.orchestrator.phases import FOLD_PHASES
from cell.orchestrator.recorder import FileRecorder, Recorder
from cell.orchestrator.run import ControlLoop, Observer
from cell.orchestrator.safe_stop import run_suppressed
from cell.perception.image_reader import (
    InlineReader,
    Measurer,
    ProcessReader,
    Reader,
    StripInputs,
)
from cell.perception.length_checks import doubts
from cell.record.documents import json_line
from cell.record.events import NOT_LEARNED
from cell.record.files import CALIBRATION, CHECKPOINT, EVENTS
from cell.record.truth import write_truth
from cell.record.writer import RunWriter
from cell.report.viz.watch import watching
from cell.setup.calibration_in_use import check_camera
from drivers.base.clock import lock_memory, take_priority, wake_promptly
from drivers.base.errors import CellError, ConfigurationError, Fault
from drivers.base.files import append_line, replace_file
from drivers.base.readers import read_bytes
from drivers.franka.shapes import desk_end
from policies.policy import Policy, at_line
from policies.registry import make_policy

# of 1 to 99, of the loop's thread: far below the process that owns the robot
PRIORITY = 20
# s after which a thread that computes hands the interpreter on
SWITCH_INTERVAL = 0.0005
Truth = Mapping[str, Any]


def fold(
    request: Request,
    calibration: Calibration,
    observers: Sequence[Observer] = (),
    interrupted: Callable[[], bool] = lambda: False,
    *,
    devices: Devices | None = None,
    policy: Policy | None = None,
) -> FoldResult:
    """Carry out one fold of a strip, seen through `calibration`, record it in a new
    folder, and return its result.

    Other `devices` or another `policy` than the request names may be given; the devices
    are closed at the end. Raises CellError for errors before the run; errors during the
    run are its outcome.
    """
    settings, strip, trial = request.settings, request.strip, request.trial
    own = policy or make_policy(request.policy, request.checkpoint)
    policy, line = at_line(own, request.line), request.line
    devices = devices or open_cell(settings, strip, trial, calibrating=False)
    with ExitStack() as opened:
        opened.callback(run_suppressed, devices.close)
        check_camera(calibration, devices)
        foreseen = assess(request, calibration).require()
        correction = request.learning.correction.apply(own)
        # what it plans takes longer than a turn of the control loop may
        policy.reset(strip, settings.fold.speed, 1)
        calibration = corrected_calibration(calibration, settings, strip)
        start = time.perf_counter()
        writer = _new_run(request, calibration, devices, correction, foreseen)
        seen = StripInputs(calibration, strip, line.goal)
        with writer.under_way(), _reader(seen, real_time=devices.real_time) as reader:
            arm = settings.arm_driver
            inputs = FoldInputs(
                settings=settings.controller,
                strip=strip,
                policy=policy,
                calibration=calibration,
                reader=reader,
                expected=foreseen.expected,
                place=0.0 if correction is None else correction.place,
                goal=line.goal,
                desk=desk_end(settings.installation, strip.length) if arm.real else 0.0,
            )
            outcome, truth, warning = _record_fold(
                request, inputs, devices, writer, observers, interrupted
            )
        learns = correction is not None and request.learning.learns
        not_learned = _learn(request, outcome, writer.folder) if learns else ""
        return replace(
            FoldResult.from_outcome(request, outcome, truth),
            run=str(writer.folder),
            calibration=calibration.id,
            wall=time.perf_counter() - start,
            warning=_warning(outcome, warning, not_learned),
        )


def _new_run(
    request: Request,
    calibration: Calibration,
    devices: Devices,
    correction: Correction | None,
    foreseen: Feasibility,
) -> RunWriter:
    """Create the folder of a run for `request`, with its header file, and return the
    writer of its record.

    On the twin, whose clock waits, the writer waits for the disk.
    """
    settings = request.settings
    header = run_header(request, settings, calibration, devices.camera.rate)
    if correction is not None:
        header["learning"] = correction.facts()
    if foreseen.reach is not None:
        header["joint_limits"] = foreseen.reach.limits.content()
    keep = request.record.frames or settings.record.frames
    on_twin = devices.plant is not None
    return RunWriter(
        request.runs, header, keep, patient=on_twin, film=request.record.film
    )


@contextmanager
def _reader(inputs: StripInputs, *, real_time: bool) -> Iterator[Reader]:
    """Context with a reader that measures the strip in camera images: in a process of
    its own where the run is in `real_time`, else in this one.
    """
    if not real_time:
        yield InlineReader(Measurer(inputs), inputs.calibration.latency)
        return
    with closing(ProcessReader(inputs, Measurer)) as reader:
        yield reader


def _record_fold(
    request: Request,
    inputs: FoldInputs,
    devices: Devices,
    writer: RunWriter,
    observers: Sequence[Observer],
    interrupted: Callable[[], bool],
) -> tuple[Outcome, Truth, str]:
    """Carry out a fold and complete the folder of its run; returns the outcome, the
    true motion where it was simulated, and a text that is to be told besides.
    """
    strip, log = inputs.strip, FoldLog()
    folder = writer.folder
    save_calibration(inputs.calibration, folder / CALIBRATION)
    if request.checkpoint is not None:
        replace_file(
            folder / CHECKPOINT, read_bytes(request.checkpoint, CHECKPOINT_BYTES)
        )
    hanging = inputs.settings.fold.start == "hanging"
    recorder = FileRecorder(writer, hanging=hanging)
    trace = FoldTrace(strip)
    live = request.record.live
    with watching(folder, strip, live=live, hanging=hanging) as live_views:
        # the controller cannot read the truth
        blind = replace(devices, plant=None, aids=None)
        watches = (trace, *observers, *live_views)
        run = ControlLoop(
            blind, inputs, log, FOLD_PHASES, recorder, watches, interrupted
        )
        outcome = run_and_record(run, devices, recorder, trace.review)
    said = (log.warning, *(view.failure for view in live_views))
    plant = devices.plant
    truth = {} if plant is None else plant.truth(recorder.origin, inputs.goal)
    if truth and request.record.truth:
        outcome = _write_truth(folder, truth, outcome)
    if (
        strip.name == UNKNOWN
        and outcome.touch is not None
        and outcome.predicted is not None
    ):
        offer_strip(folder, strip, outcome.predicted)
    return outcome, truth, "\n  ".join(filter(None, said))


def _write_truth(folder: Path, truth: Truth, outcome: Outcome) -> Outcome:
    """Write the true motion of the simulated strip into the run `folder`; returns
    `outcome`, or a fault where the file cannot be written.
    """
    try:
        write_truth(folder, truth)
    except OSError as error:
        reason = f"{folder}: {error.strerror}; it is incomplete"
        return outcome.overridden_by(Outcome("record", reason, Fault.exit_code))
    return outcome


def _learn(request: Request, outcome: Outcome, folder: Path) -> str:
    """Store in the memory of the cell how far the fold of `request` deviates from its
    prediction, and return why it cannot be stored.

    The record keeps that reason too; it is empty where the deviation is stored, or
    where the fold is not usable.
    """
    learning = request.learning
    subject = request.subject
    try:
        key = run_key(folder)
        experience = experience_of(
            folder.name, subject, outcome, learning.correction, key
        )
        if experience is not None:
            memory_of(request).add(experience)
    except ConfigurationError as error:
        failure = f"nothing was learned: {error}"
        note = {"t": outcome.duration, "kind": NOT_LEARNED, "reason": failure}
        with suppress(OSError):
            append_line(folder / EVENTS, json_line(note))
        return failure
    return ""


def run_and_record(
    run: ControlLoop,
    devices: Devices,
    recorder: FileRecorder,
    review: Callable[[Outcome, Recorder], Outcome] = lambda outcome, _: outcome,
) -> Outcome:
    """Execute the control loop `run`, close the devices, let `review` change the
    outcome, and record it, whatever errors occur.
    """
    try:
        devices.connect()
        with realtime_thread(devices.real_time):
            outcome = run.execute()
    except KeyboardInterrupt:
        outcome = replace(INTERRUPTED_AT_ONCE, duration=devices.clock.now())
    except CellError as error:
        outcome = replace(Outcome.from_error(error), duration=devices.clock.now())
    finally:
        run_suppressed(devices.close)
    timing = devices.arm_timing()
    if timing:
        run_suppressed(lambda: recorder.describe(arm_timing=dict(timing)))
    run_suppressed(lambda: recorder.joints(devices.arm_joints()))
    return _review_and_finish(outcome, recorder, review)


def _review_and_finish(
    outcome: Outcome,
    recorder: FileRecorder,
    review: Callable[[Outcome, Recorder], Outcome],
) -> Outcome:
    """Let `review` change the `outcome`, write it as the run's result, and close the
    record in any event.
    """
    content = result_content(outcome)  # for a review that is interrupted
    try:
        outcome = review(outcome, recorder)
        content = result_content(outcome)
        recorder.finish(content)
    except KeyboardInterrupt:
        recorder.finish(content)
        raise
    except Fault as fault:
        outcome = outcome.overridden_by(Outcome.from_error(fault))
    finally:
        run_suppressed(recorder.close)
    return outcome


@contextmanager
def realtime_thread(real_time: bool) -> Iterator[None]:
    """Context in which the thread of the control loop keeps its times, where the run is
    in `real_time`; else it changes nothing.

    The thread takes precedence over threads that record or show: by real-time priority
    where this user may have it, else by short slices of processor time. Memory is
    locked, and objects made before are excluded from garbage collection: to look at
    half a million of the libraries takes longer than an arm follows a velocity target.
    """
    if not real_time:
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    lock_memory()
    if not take_priority(PRIORITY):
        wake_promptly()
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(interval)
        os.sched_setscheduler(0, policy, parameters)


def _warning(outcome: Outcome, *others: str) -> str | None:
    """Text for the operator on lengths that disagree, on a strip that behaves unlike
    its model, and on whatever `others` say; None where there is nothing to warn of.
    """
    agreement = outcome.agreement
    lines = list(dict.fromkeys(doubts(outcome.witnesses).values()))
    if agreement is not None and not agreement.like_model:
        lines.append(agreement.sentence())
    return "\n  ".join(filter(None, (*lines, *others))) or None
