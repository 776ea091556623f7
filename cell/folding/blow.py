"""One fold under a fault of the campaign, and its result."""

import resource
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.calibration import Calibration
from cell.config.cell import CellFile
from cell.config.places import find_configs
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.failing import PERIOD, Failing
from cell.devices.open import open_cell
from cell.folding.faults import FAULTS, FailingPolicy, Scene
from cell.folding.fold import Request, fold
from cell.folding.result import FoldResult
from cell.orchestrator.interrupt import Interrupt
from cell.orchestrator.snapshot import Snapshot
from cell.record.run import read_run
from drivers.errors import CellError
from drivers.installation import Installation
from drivers.types import Array
from policies.policy import Policy

FAULT_STATES = ("FOLD", "LAY", "TOUCHED", "RELEASE", "STOPPING", "LIFT", "GRASP", "PREFLIGHT")
FAULT_DELAY = 0.25  # s in the state before the fault strikes
REST_SPEED = 0.002  # m/s below which a gripper rests
# m that a good fold's measurement may be off the truth: what a cell states as sigma
DISPLACEMENT_TOLERANCE = 0.003
RATE_SAMPLES = 5  # looks at the gripper over which its rate is judged: it follows a robot in steps
LIMIT_FACTOR = 1.02  # of a limit, for what sampling makes of it
CAMERA_RATE = 20.0  # Hz: an image is the dearest part of a simulated fold


@dataclass(frozen=True, slots=True)
class Blow:
    """A case of the campaign: the fault called `fault` in `state`, seeded by `seed`."""

    fault: str
    state: str
    seed: int


class Striker:
    """Observer that triggers the fault once: a while after `state` began, or at once."""

    def __init__(self, blow: Blow, scene: Callable[[], Scene]) -> None:
        """Observe the fold that `scene` gives once it is opened; times are the world's [s]."""
        self._blow, self._scene = blow, scene
        self._begun: float | None = None
        self.at: float | None = None
        self.fault: tuple[float, str, str] | None = None

    @property
    def stops(self) -> bool:
        """Whether the operator stops the run, so that the fault can strike while it does."""
        return self._blow.state == "STOPPING" and self._begun is not None

    def see(self, snapshot: Snapshot) -> None:  # noqa: ARG002
        """Trigger the fault when it is due."""
        begun = self._begun
        if begun is None or self.at is not None or self._blow.state == "STOPPING":
            return
        if self._scene().cell.now >= begun + FAULT_DELAY:
            self._strike()

    def note(self, _time: float, kind: str, facts: dict[str, object]) -> None:
        """Note the states, and the fault as the cell names it."""
        state, time = self._blow.state, self._scene().cell.now
        if kind == "fault" and self.fault is None:
            self.fault = (time, str(facts["name"]), str(facts["reason"]))
        if kind != "state":
            return
        if facts["state"] == state and state in ("TOUCHED", "STOPPING"):
            self._strike()
        elif facts["state"] == ("FOLD" if state == "STOPPING" else state):
            self._begun = time

    handle_event = note

    def _strike(self) -> None:
        if self.at is None:
            self.at = self._scene().cell.now
            FAULTS[self._blow.fault].strike(self._scene())


def strike(blow: Blow, folder: Path, calibration: Calibration) -> Mapping[str, Any]:
    """Result of `blow` in a fold recorded in `folder`; plain values [s, m].

    `verdict` is stopped (by a named fault), harmless (the fold went through and its measurement is
    right), not struck (the state never came), else undetected.
    """
    scenes: list[Scene] = []
    striker = Striker(blow, lambda: scenes[0])
    policies: list[FailingPolicy] = []
    cells: list[Failing] = []

    def open_failing(settings: CellFile, *rest: Any, **options: Any) -> Devices:
        cells.append(Failing(open_cell(settings, *rest, **options)))
        scenes.append(Scene(cells[0], policies[0], _pixels_of_two_mm(calibration)))
        return cells[0].devices

    def leads(policy: Policy) -> Policy:
        policies.append(FailingPolicy(policy))
        return policies[0]

    cell = find_configs(_configure(folder)).cell()
    calibration = replace(calibration, camera=cell.twin.camera.identity)  # but for its rate
    with _free_disk(), Interrupt() as interrupted:
        try:
            result = fold(
                _request(blow, folder), lambda _f, _s: (striker,),
                lambda: interrupted() or striker.stops, calibration,
                opened=open_failing, leads=leads, page=False,
            )  # fmt: skip
        except CellError as error:
            result = FoldResult.refusal("denim", "triangular", blow.seed, error)
    for cell_struck in cells:
        cell_struck.look()
    moves = np.array(cells[0].motion) if cells else np.zeros((0, 4))
    return _result_values(blow, striker, result, moves, cell.installation)


def _result_values(
    blow: Blow, striker: Striker, result: FoldResult, motion: Array, place: Installation
) -> Mapping[str, Any]:
    """The result as plain values; `motion` (n, 4) as in `Failing`."""
    whole = _record_is_whole(result, spares=FAULTS[blow.fault].spares)
    facts = {
        "verdict": _verdict(striker, result),
        "outcome": result.outcome,
        "exit_code": result.exit_code,
        "message": result.reason,
        "whole": whole,
    }
    if striker.at is None:
        return facts
    rates = np.diff(motion[:, 1:], axis=0) / PERIOD
    whole_steps = np.diff(motion[::RATE_SAMPLES, 1:], axis=0) / (RATE_SAMPLES * PERIOD)
    after = motion[1:, 0] > striker.at
    speed = np.hypot(rates[:, 0], rates[:, 1])
    stopped = facts["verdict"] == "stopped"
    late = motion[1:, 0][after & (speed > REST_SPEED)]
    path = float(PERIOD * speed[after].sum())
    return facts | {
        "stop": striker.fault[0] - striker.at if stopped and striker.fault else None,
        "rest": float(late.max() - striker.at) if stopped and late.size else None,
        "distance": path if stopped else None,
        "resting": bool((speed[-1:] < REST_SPEED).all()),
        "within": _within_limits(motion, whole_steps, place),
    }


def _verdict(striker: Striker, result: FoldResult) -> str:
    if striker.at is None:
        return "not struck"
    if result.outcome == "internal_error":
        return "undetected"
    if result.exit_code > 1:
        return "stopped"
    seen, true = result.displacement, result.displacement_true
    right = seen is not None and true is not None and abs(seen - true) <= DISPLACEMENT_TOLERANCE
    return "harmless" if right or result.exit_code == 1 else "undetected"


def _within_limits(motion: Array, rates: Array, place: Installation) -> bool:
    """Whether the arm stayed within its limits and its workspace."""
    limits, box = place.limits, place.workspace
    quick = all(
        np.abs(rates[:, i]).max() <= LIMIT_FACTOR * axis.velocity
        for i, axis in enumerate(limits.axes)
    )
    inside = all(
        low - 0.005 <= motion[:, 1 + i].min() and motion[:, 1 + i].max() <= high + 0.005
        for i, (low, high) in enumerate((box.x, box.z))
    )
    return bool(quick and inside)


def _record_is_whole(result: FoldResult, *, spares: bool) -> bool:
    """Whether the record can be read and states the outcome of `result`; where the fault does not
    spare the record, as a full disk, it may state none.
    """
    try:
        run = read_run(Path(result.run)) if result.run else None
    except CellError:
        run = None
    if run is None:
        return False
    stated = run.result
    return not spares if stated is None else stated.outcome == result.outcome


def _request(blow: Blow, folder: Path) -> Request:
    """A quick fold of denim with the arm that can suffer the fault."""
    choice = DeviceSelection(arm=FAULTS[blow.fault].arm, seed=blow.seed)
    return Request(
        "denim", "triangular", None, choice, folder / "runs", _configure(folder), "none",
        truth=True, viz="off",
    )  # fmt: skip


def _configure(folder: Path) -> Path:
    """Folder with this campaign's cell: fewer images, and a policy that may hang less long."""
    from cell.record.documents import write_document

    made = folder / "configs"
    if made.exists():
        return made
    usual = find_configs(None)
    (made / "strips").mkdir(parents=True)
    content = usual.cell().model_dump(mode="json", by_alias=True, exclude_unset=True)
    content["twin"] = content["twin"] | {"camera": {"rate": CAMERA_RATE}, "world": {"links": 60}}
    content["monitors"] = {"turn": 15.0, "state_duration": 20.0}
    write_document(made / "cell.yaml", content)
    strip = usual.strip("denim").model_dump(mode="json", by_alias=True, exclude_unset=True)
    write_document(made / "strips" / "denim.yaml", strip | {"length": 0.36, "spread": {}})
    return made


def _pixels_of_two_mm(calibration: Calibration) -> tuple[float, float]:
    """Shift in the image [px] of 2 mm along the desk."""
    here, there = calibration.to_image(np.array([(0.2, 0.0), (0.202, 0.0)]))
    x, y = (there - here).tolist()
    return x, y


@contextmanager
def _free_disk() -> Iterator[None]:
    """Remove the limit on file sizes that fills the disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
