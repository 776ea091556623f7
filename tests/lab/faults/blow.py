"""Runs a fold with an injected fault of the campaign, and evaluates how the cell
reacted.
"""

import resource
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.calibration import Calibration
from cell.base.config.cell import CellFile
from cell.base.config.places import find_configs
from cell.base.devices.devices import Trial
from cell.base.devices.open import open_cell
from cell.folding.fold import fold
from cell.folding.request import RecordingOptions, Request
from cell.folding.result import FoldResult
from cell.orchestrator.operator import Interrupt
from cell.orchestrator.snapshot import Snapshot
from cell.record.run import read_run
from drivers.base.errors import CellError
from drivers.base.installation import Installation
from drivers.base.settings import parse
from drivers.base.types import Array
from policies.registry import make_policy
from tests.lab.faults.failing import PERIOD, Failing, FailingPolicy
from tests.lab.faults.faults import FAULTS, Scene

FAULT_STATES = (
    "FOLD",
    "LAY",
    "TOUCHED",
    "RELEASE",
    "STOPPING",
    "LIFT",
    "GRASP",
    "PREFLIGHT",
)
FAULT_DELAY = 0.25  # s in the state before the fault strikes
REST_SPEED = 0.002  # m/s below which a gripper rests
# m that a good fold's measurement may be off the truth: what a cell states as sigma
DISPLACEMENT_TOLERANCE = 0.003
# looks at the gripper over which its rate is judged: it follows a robot in steps
RATE_SAMPLES = 5
LIMIT_FACTOR = 1.02  # of a limit, for what sampling makes of it
BOX_MARGIN = 0.005  # m about the workspace
CAMERA_RATE = 20.0  # Hz: an image is the dearest part of a simulated fold


@dataclass(frozen=True, slots=True)
class Blow:
    """Case of the fault campaign: `fault` injected in `state`, with the random
    `seed`.
    """

    fault: str
    state: str
    seed: int


class Striker:
    """Observer that injects the fault once, FAULT_DELAY after the start of its
    state.
    """

    def __init__(self, blow: Blow, scene: Callable[[], Scene]) -> None:
        """Observe the fold that `scene` gives once it is opened; times are the world's
        [s].
        """
        self._blow, self._scene = blow, scene
        self._begun: float | None = None
        self.at: float | None = None
        self.fault: tuple[float, str, str] | None = None

    @property
    def stops(self) -> bool:
        """Whether the operator stops the run now, for a fault that strikes during the
        stop.
        """
        return self._blow.state == "STOPPING" and self._begun is not None

    def handle_tick(self, snapshot: Snapshot) -> None:
        """Inject the fault when it is due."""
        begun = self._begun
        if begun is None or self.at is not None or self._blow.state == "STOPPING":
            return
        if self._scene().cell.now >= begun + FAULT_DELAY:
            self._strike()

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """Note when states begin, and the first fault that the cell reports."""
        state, now = self._blow.state, self._scene().cell.now
        if kind == "fault" and self.fault is None:
            self.fault = (now, str(facts["name"]), str(facts["reason"]))
        if kind != "state":
            return
        if facts["state"] == state and state in ("TOUCHED", "STOPPING"):
            self._strike()
        elif facts["state"] == ("FOLD" if state == "STOPPING" else state):
            self._begun = now

    def _strike(self) -> None:
        if self.at is None:
            self.at = self._scene().cell.now
            FAULTS[self._blow.fault].strike(self._scene())


def strike(blow: Blow, folder: Path, calibration: Calibration) -> Mapping[str, Any]:
    """Fold with the fault of `blow`, recorded in `folder`; returns the result in plain
    values.

    `verdict` is stopped (by a named fault), harmless (the fold went through and its
    measurement is right), not struck (the state never came), else undetected. Times in
    s, lengths in m.
    """
    scenes: list[Scene] = []
    striker = Striker(blow, lambda: scenes[0])
    request = _request(blow, folder / "runs")
    cell, identity = request.cell, request.cell.twin.camera.identity
    calibration = replace(calibration, camera=identity)  # but for its rate
    with _free_disk(), Interrupt() as interrupted:
        try:
            policy = FailingPolicy(make_policy(request.policy))
            devices = open_cell(
                request.settings, request.strip, request.trial, calibrating=False
            )
            scenes.append(
                Scene(Failing(devices), policy, _pixels_of_two_mm(calibration))
            )
            result = fold(
                request,
                calibration,
                (striker,),
                lambda: interrupted() or striker.stops,
                devices=scenes[0].cell.devices,
                policy=policy,
            )
        except CellError as error:
            result = FoldResult.refusal(request, error)
    for scene in scenes:
        scene.cell.look()
    motion = np.array(scenes[0].cell.motion) if scenes else np.zeros((0, 4))
    return _result_values(blow, striker, result, motion, cell.installation)


def _result_values(
    blow: Blow, striker: Striker, result: FoldResult, motion: Array, place: Installation
) -> Mapping[str, Any]:
    """Result of the fold as plain values; `motion` (n, 4) as in `Failing`."""
    at = striker.at
    facts = {
        "verdict": _verdict(striker, result),
        "outcome": result.outcome,
        "exit_code": result.exit_code,
        "message": result.reason,
        "whole": _record_is_whole(result, spares=FAULTS[blow.fault].spares),
    }
    if at is None:
        return facts
    times = motion[1:, 0]
    rates = np.diff(motion[:, 1:], axis=0) / PERIOD
    speed = np.hypot(rates[:, 0], rates[:, 1])
    after = times > at
    moving = times[after & (speed > REST_SPEED)]
    stopped = facts["verdict"] == "stopped"
    return facts | {
        "stop": striker.fault[0] - at if stopped and striker.fault else None,
        "rest": float(moving.max() - at) if stopped and moving.size else None,
        "distance": float(PERIOD * speed[after].sum()) if stopped else None,
        "resting": bool((speed[-1:] < REST_SPEED).all()),
        "within": _within_limits(motion, place),
    }


def _verdict(striker: Striker, result: FoldResult) -> str:
    if striker.at is None:
        return "not struck"
    if result.outcome == "internal_error":
        return "undetected"
    if result.exit_code > 1:
        return "stopped"
    seen, true = result.displacement, result.displacement_true
    right = (
        seen is not None
        and true is not None
        and abs(seen - true) <= DISPLACEMENT_TOLERANCE
    )
    return "harmless" if right or result.exit_code == 1 else "undetected"


def _within_limits(motion: Array, place: Installation) -> bool:
    """Whether the arm stayed within its speed limits and its workspace in `motion` (n,
    4).
    """
    limits, box = place.limits, place.workspace
    rates = np.diff(motion[::RATE_SAMPLES, 1:], axis=0) / (RATE_SAMPLES * PERIOD)
    quick = all(
        np.abs(rates[:, i]).max() <= LIMIT_FACTOR * axis.velocity
        for i, axis in enumerate(limits.axes)
    )
    inside = all(
        low - BOX_MARGIN <= motion[:, 1 + i].min()
        and motion[:, 1 + i].max() <= high + BOX_MARGIN
        for i, (low, high) in enumerate((box.x, box.z))
    )
    return bool(quick and inside)


def _record_is_whole(result: FoldResult, *, spares: bool) -> bool:
    """Whether the record can be read and holds the outcome, unless the fault hits the
    record.
    """
    try:
        run = read_run(Path(result.run)) if result.run else None
    except CellError:
        run = None
    if run is None:
        return False
    stated = run.result
    return not spares if stated is None else stated.outcome == result.outcome


def _request(blow: Blow, runs: Path) -> Request:
    """A quick fold with the arm that can suffer the fault: a short strip, few images
    and links.
    """
    usual = find_configs(None)
    content = usual.cell().model_dump(by_alias=True, exclude_unset=True)
    content["twin"] |= {"camera": {"rate": CAMERA_RATE}, "world": {"links": 60}}
    content["monitors"] = {"turn": 15.0, "state_duration": 20.0}
    strip = usual.strip("denim").model_copy(update={"length": 0.36, "spread": {}})
    cell = parse(content, CellFile, "cell").with_drivers(FAULTS[blow.fault].arm)
    trial, record = Trial(seed=blow.seed), RecordingOptions("none")
    return Request(cell, strip, "triangular", runs, trial, record=record)


def _pixels_of_two_mm(calibration: Calibration) -> tuple[float, float]:
    """Shift in the image [px] of 2 mm along the desk."""
    here, there = calibration.to_image(np.array([(0.2, 0.0), (0.202, 0.0)]))
    x, y = (there - here).tolist()
    return x, y


@contextmanager
def _free_disk() -> Iterator[None]:
    """Restore the file-size limit after the block, in which a fault may simulate a full
    disk.
    """
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
