"""Folds one strip: opens devices and calibration, runs, records, scores."""

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

from calibration.calibration import Calibration, save_calibration
from cell.arm.arm_settings import settings_of_run
from cell.calibrating.calibrate import calibration_of
from cell.calibrating.calibration_in_use import check_usable, record_entry
from cell.config.cell import CellFile
from cell.config.places import find_configs
from cell.config.unknown import UNKNOWN_NAME as UNKNOWN
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.open import DeviceFactory, is_physical, open_cell
from cell.devices.rig_correction import corrected_calibration
from cell.folding.feasible import check_feasible
from cell.folding.fold_trace import FoldTrace
from cell.folding.learned import offer
from cell.folding.result import FoldResult
from cell.folding.steady import punctual
from cell.learning.correction import Correction, experience_of, subject_of
from cell.learning.experience import Memory, run_key
from cell.orchestrator.context import FoldContext
from cell.orchestrator.outcome import INTERRUPTED_AT_ONCE, Outcome, StopReason
from cell.orchestrator.recorder import Record, Recorder
from cell.orchestrator.run import Observer, Run
from cell.orchestrator.safe_stop import run_suppressed
from cell.perception.sight import InlineReader, Maker, ProcessReader, Reader, StripSight, Subject
from cell.record.files import CALIBRATION, CHECKPOINT
from cell.record.film import Encoder
from cell.record.frames import Keep
from cell.record.truth import write_truth
from cell.record.writer import RunWriter
from cell.report.page import write_report
from cell.report.viz.watch import Mode, watching
from drivers.arm.obstacles import desk_end
from drivers.errors import CellError, Fault
from drivers.files import replace_file
from drivers.readers import MEGABYTE, read_bytes
from drivers.strip.describe import load_plant
from drivers.strip.file import StripFile
from policies.policy import Policy
from policies.registry import make_policy

CHECKPOINT_BYTES = 50 * MEGABYTE
PACKAGES = ("folding-cell", "mujoco", "opencv-python-headless", "numpy", "ruckig")


@dataclass(frozen=True, slots=True)
class Request:
    """Specification of one fold; plain values, so that another process can execute it."""

    strip: str
    policy: str
    checkpoint: Path | None
    choice: DeviceSelection
    runs: Path
    configs: Path | None
    frames: Keep | None
    truth: bool
    viz: Mode | Literal["off"]
    speed: float | None = None  # m/s on the path, instead of the cell's own
    full_speed: bool = False  # of a real robot, which is slowed otherwise
    specimen: str | None = None  # of the strip, as the operator names it
    correction: Correction = field(default_factory=lambda: Correction(0.0, 0.0))
    learns: bool = False  # whether the cell keeps the fold's bias
    memory: Path | None = None  # folder of what the cell learned, instead of the user's
    film: Encoder | None = None  # by which a film of its images is kept
    files: tuple[CellFile, StripFile] | None = None  # as read once for all folds of a batch

    def read_files(self) -> tuple[CellFile, StripFile]:
        """Settings of the cell and the strip: `files`, or those in the configuration now."""
        if self.files is not None:
            return self.files
        configs = find_configs(self.configs)
        return configs.cell(), configs.strip(self.strip)

    def files_of_run(self) -> tuple[CellFile, StripFile]:
        """Settings of the cell and the strip as the run uses them, by `settings_of_run`."""
        stated, strip = self.read_files()
        return settings_of_run(stated, self.choice, self.speed, full_speed=self.full_speed), strip


def fold(
    request: Request,
    observers: Callable[[Path, StripFile], tuple[Observer, ...]] = lambda _folder, _strip: (),
    interrupted: Callable[[], bool] = lambda: False,
    calibration: Calibration | None = None,
    *,
    opened: DeviceFactory | None = None,
    leads: Callable[[Policy], Policy] = lambda policy: policy,
    sight: Maker = StripSight,
    page: bool = True,
) -> FoldResult:
    """Fold once, with `calibration` or the one that the cell uses.

    `opened` opens another cell than the configured one, `leads` may replace the policy, and `sight`
    what measures images on the wall clock; without `page` no report is written. Raises CellError
    for errors before the run; errors during the run are its outcome.
    """
    settings, strip = request.files_of_run()
    policy = leads(make_policy(request.policy, request.checkpoint))
    correction = request.correction.apply(policy)
    policy.reset(strip, settings.fold.speed, 1)
    devices = (opened or open_cell)(settings, strip, request.choice, calibrating=False)
    calibration = calibration or calibration_of(settings)
    check_usable(calibration, devices, settings.calibration_days, datetime.now(UTC))
    calibration = corrected_calibration(calibration, settings, strip)
    has_hand = request.choice.arm_driver(settings).real
    desk = desk_end(settings.installation, strip.length) if has_hand else 0.0
    check_feasible(settings, strip, policy, calibration, desk)
    begun = time.perf_counter()
    header = run_header(request, settings, strip, calibration, devices.camera.rate)
    header |= {} if correction is None else {"learning": correction.facts()}
    keep = request.frames or settings.record.frames
    writer = RunWriter.create(
        request.runs, header, keep, patient=devices.plant is not None, film=request.film
    )
    subject = Subject(calibration, settings.perception, strip)
    with writer.under_way(), _reader(subject, sight, real_time=devices.real_time) as reader:
        context = FoldContext(settings.controller, strip, policy, calibration, reader, desk=desk)
        context.place = 0.0 if correction is None else correction.place
        outcome, truth = _record_fold(
            request, context, devices, writer, observers, interrupted, page=page
        )
    if correction is not None:
        _store_experience(request, settings, strip, outcome, writer.folder)
    warning = _warning(outcome, context.warning)
    return _result(request, strip, calibration, outcome, writer.folder, truth, begun, warning)


@contextmanager
def _reader(subject: Subject, sight: Maker, *, real_time: bool) -> Iterator[Reader]:
    """Reader of images for the block: a process where the run is on the wall clock."""
    if not real_time:
        yield InlineReader(sight(subject), subject.calibration.latency)
        return
    with closing(ProcessReader(subject, sight)) as reader:
        yield reader


def _record_fold(
    request: Request,
    context: FoldContext,
    devices: Devices,
    writer: RunWriter,
    observers: Callable[[Path, StripFile], tuple[Observer, ...]],
    interrupted: Callable[[], bool],
    *,
    page: bool,
) -> tuple[Outcome, Mapping[str, Any]]:
    """Fold with a record and complete its folder; returns the outcome and the plant's truth."""
    strip, folder = context.strip, writer.folder
    save_calibration(context.calibration, folder / CALIBRATION)
    if request.checkpoint is not None:
        replace_file(folder / CHECKPOINT, read_bytes(request.checkpoint, CHECKPOINT_BYTES))
    hanging = context.settings.fold.start == "hanging"
    recorder = Recorder(writer, hanging=hanging)
    with watching(request.viz, hanging=hanging) as watch:
        trace = FoldTrace(strip)
        watchers = (trace, *observers(folder, strip), *watch(folder, strip))
        blind = replace(devices, plant=None, aids=None)  # what controls has no way to the truth
        run = Run(blind, context, recorder, watchers, interrupted)
        outcome = conduct(run, devices, recorder, trace.review)
    truth = {} if devices.plant is None else devices.plant.truth(recorder.origin)
    outcome = _complete_folder(outcome, folder, truth if request.truth else {}, page=page)
    if strip.name == UNKNOWN and outcome.touch is not None and outcome.predicted is not None:
        offer(folder, strip, outcome.predicted)
    return outcome, truth


def _store_experience(
    request: Request, settings: CellFile, strip: StripFile, outcome: Outcome, folder: Path
) -> None:
    """Store the fold's bias, where the cell learns."""
    subject = subject_of(request.policy, request.checkpoint, strip.name, request.specimen)
    key = run_key(folder)
    experience = experience_of(folder.name, subject, outcome, request.correction, key)
    if request.learns and experience is not None:
        twin = not is_physical(settings, request.choice)
        Memory(settings.name, request.memory, twin=twin).add(experience)


def conduct(
    run: Run,
    devices: Devices,
    recorder: Recorder,
    review: Callable[[Outcome, Record], Outcome] = lambda outcome, _: outcome,
) -> Outcome:
    """Execute `run`, close the devices and record the outcome, whatever happens.

    `review` adds to the outcome what is found out only afterwards.
    """
    try:
        devices.connect()
        with punctual(devices.real_time):
            outcome = run.execute()
    except KeyboardInterrupt:
        outcome = Outcome.of(INTERRUPTED_AT_ONCE, devices.clock.now())
    except CellError as error:
        outcome = Outcome.of(StopReason.by(error), devices.clock.now())
    finally:
        run_suppressed(devices.close)
    timing = devices.arm_timing()
    if timing:
        run_suppressed(lambda: recorder.describe(arm_timing=dict(timing)))
    run_suppressed(lambda: recorder.joints(devices.arm_joints()))
    content = result_content(outcome)  # for a review that is interrupted
    try:
        outcome = review(outcome, recorder)
        content = result_content(outcome)
        recorder.finish(content)
    except KeyboardInterrupt:
        recorder.finish(content)
        raise
    except Fault as fault:
        outcome = outcome.but(StopReason.by(fault))
    finally:
        run_suppressed(recorder.close)
    return outcome


def result_content(outcome: Outcome) -> dict[str, Any]:
    """Content of result.yaml for an outcome."""
    content: dict[str, Any] = {"outcome": outcome.name, "reason": outcome.reason}
    content["duration"] = outcome.duration
    if outcome.touch is not None:
        content |= outcome.touch.facts()
    if outcome.edge_offset is not None:
        content["edge_offset"] = outcome.edge_offset
    if outcome.predicted is not None:
        content["foretold"] = asdict(outcome.predicted)
    if outcome.agreement is not None:
        agreed = outcome.agreement
        facts = {"like_model": agreed.like_model, "reason": agreed.sentence()}
        content["agreement"] = asdict(agreed) | facts
    return content


def run_header(
    request: Request,
    settings: CellFile,
    strip: StripFile,
    calibration: Calibration,
    camera_rate: float,
) -> dict[str, Any]:
    """Content of run.yaml: all that readers need, versions, and a hash of the plant.

    `camera_rate` is that of the open camera [Hz].
    """
    choice = request.choice
    return {
        "strip": strip.name,
        "sigma": settings.sigma.model_dump(),
        "start": settings.fold.start,
        "index": choice.index,
        "condition": f"{request.policy} at {settings.fold.speed:g} m/s",
        "speed": settings.fold.speed,
        "camera_hz": camera_rate,
        "contact_height": settings.perception.contact_height,
        "policy": request.policy,
        **_replaced_weights(request.checkpoint),
        "seed": choice.seed,
        "drivers": {
            "arm": choice.arm or settings.drivers.arm,
            "camera": choice.camera or settings.drivers.camera,
        },
        "calibration": record_entry(calibration, datetime.now(UTC)),
        "versions": {package: version(package) for package in PACKAGES},
        "strip_file": strip.model_dump(mode="json", by_alias=True),
        "config": settings.model_dump(mode="json", by_alias=True),
        "plant_sha256": _plant_hash(choice, strip),
    }


def _complete_folder(
    outcome: Outcome, folder: Path, truth: Mapping[str, Any], *, page: bool
) -> Outcome:
    """Write the truth (on the twin) and the page; returns the outcome, with a failure to write."""
    try:
        if truth:
            write_truth(folder, truth)
        if page:
            write_report(folder, ended=True)
    except OSError as error:
        return outcome.but(
            StopReason("record", f"{folder}: {error.strerror}; it is incomplete", Fault.exit_code)
        )
    except CellError as error:
        return outcome.but(StopReason("record", str(error), Fault.exit_code))
    return outcome


def _plant_hash(choice: DeviceSelection, strip: StripFile) -> str:
    plant = strip if choice.plant is None else load_plant(choice.plant)
    content = plant.model_dump(mode="json", by_alias=True)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _replaced_weights(checkpoint: Path | None) -> dict[str, Any]:
    """Entry of run.yaml about a checkpoint in place of the committed weights; empty for None."""
    if checkpoint is None:
        return {}
    digest = hashlib.sha256(read_bytes(checkpoint, CHECKPOINT_BYTES)).hexdigest()
    return {"checkpoint": {"file": str(checkpoint), "sha256": digest}}


def _warning(outcome: Outcome, preflight: str) -> str | None:
    """Warnings for the operator, on an unlike strip and from `preflight`; None without any."""
    agreed = outcome.agreement
    unlike = "" if agreed is None or agreed.like_model else agreed.sentence()
    return "\n  ".join(filter(None, (unlike, preflight))) or None


def _result(
    request: Request,
    strip: StripFile,
    calibration: Calibration,
    outcome: Outcome,
    folder: Path,
    truth: Mapping[str, Any],
    begun: float,
    warning: str | None,
) -> FoldResult:
    touch = outcome.touch
    return FoldResult(
        run=str(folder),
        strip=strip.name,
        policy=request.policy,
        seed=request.choice.seed,
        outcome=outcome.name,
        reason=outcome.reason,
        displacement=None if touch is None else touch.displacement,
        displacement_true=truth.get("displacement"),
        layer_touch=None if touch is None else touch.time,
        edge_offset=outcome.edge_offset,
        edge_offset_true=truth.get("edge_offset"),
        duration=outcome.duration,
        wall=time.perf_counter() - begun,
        calibration=calibration.id,
        exit_code=outcome.exit_code,
        predicted=None if outcome.predicted is None else outcome.predicted.sentence(),
        warning=warning,
        like_model=None if outcome.agreement is None else outcome.agreement.like_model,
        correction=request.correction.sentence(),
    )
