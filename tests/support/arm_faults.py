"""Faults of a robot, struck in mid-fold through its own library, and what came of it."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from cell.config.places import find_configs
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.fci import start_joints
from cell.devices.open import open_cell
from cell.folding.fold import fold_with
from cell.folding.request import Recording, Request
from cell.orchestrator.snapshot import Snapshot
from cell.record.run import read_run
from drivers.arm.bridge import Bridge
from drivers.arm.process import Task
from drivers.errors import CellError, Fault
from drivers.fci_server.faults import (
    ContactFault,
    DropFault,
    FreezeFault,
    NanFault,
    ReflexFault,
    UserStopFault,
    VersionFault,
)
from drivers.fci_server.server import RobotServer, ServerSettings
from drivers.types import frozen
from policies.registry import make_policy
from tests.support.requests import request_for

PHASES = ("PREFLIGHT", "GRASP", "LIFT", "FOLD", "LAY")
AFTER = 0.25  # s in the phase before the fault strikes
PATIENCE = 1.0  # s for the arm to come to rest
DIED = "died, and the record says so"


@dataclass(frozen=True)
class Scene:
    """The fold under way, for the one who strikes."""

    devices: Devices
    server: RobotServer
    bridge: Callable[[], Bridge]


Strike = Callable[[Scene], None]


@dataclass(frozen=True)
class Came:
    """What came of a fault: `outcome`, whether the arm rests and the record is whole, and the
    longest time [s] for which nothing happened after the strike.
    """

    fault: str
    phase: str
    outcome: str
    expected: tuple[str, ...]
    rests: bool
    whole: bool
    hang: float

    @property
    def passed(self) -> bool:
        named = self.outcome in self.expected
        return named and self.rests and self.whole and self.hang < 2.0


def inject(*faults) -> Strike:
    return lambda scene: [scene.server.inject(fault) for fault in faults] and None


def silent(scene: Scene) -> None:
    """The control loop hangs for a second of the cell's time."""
    scene.devices.clock.wait_until(scene.devices.clock.now() + 1.0)


def killed(scene: Scene) -> None:
    os.kill(scene.bridge().process, signal.SIGKILL)


SURVIVED = ("layer_touch",)
STRIKES: dict[str, tuple[Strike, tuple[str, ...]]] = {
    "reflex": (inject(ReflexFault(kind="reflex", at=0)), ("arm_reflex",)),
    "user stop": (inject(UserStopFault(kind="user_stop", at=0)), ("arm_user_stop",)),
    "TCP drop": (inject(DropFault(kind="tcp_drop", at=0)), ("arm_network",)),
    "frozen 0.7 s": (inject(FreezeFault(kind="freeze", at=0, duration=0.7)), SURVIVED),
    "frozen 1.5 s": (inject(FreezeFault(kind="freeze", at=0, duration=1.5)), ("arm_network",)),
    "wrong version": (
        inject(VersionFault(kind="wrong_version", at=0), DropFault(kind="tcp_drop", at=0)),
        ("arm_network, then arm_version",),
    ),
    "NaN": (inject(NanFault(kind="nan", at=0, ticks=3)), ("arm_pose_not_finite",)),
    "contact 20 N": (
        inject(ContactFault(kind="contact", at=0, force=(0.0, 0.0, 20.0))),
        ("arm_contact",),
    ),
    "silent parent": (silent, ("arm_cell_silent", "setpoint_expired")),
    "killed child": (killed, ("arm_driver_lost",)),
    "killed parent": (lambda scene: None, (DIED,)),
}


class Striker:
    """Watches a fold and strikes once, a while after a phase began; times what comes after."""

    def __init__(self, phase: str, strike: Callable[[], None]) -> None:
        self._phase, self._strike = phase, strike
        self._begun: float | None = None
        self._last: float | None = None
        self.hang = 0.0

    def see(self, snapshot: Snapshot) -> None:
        self.tell()
        if self._begun is not None and snapshot.time >= self._begun + AFTER:
            self._begun, self._last = None, time.perf_counter()
            self._strike()

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        if kind == "state" and facts["state"] == self._phase and self._last is None:
            self._begun = time

    def tell(self) -> None:
        """Something happened."""
        if self._last is not None:
            now = time.perf_counter()
            self.hang, self._last = max(self.hang, now - self._last), now

    def end(self) -> None:
        """The last thing has happened."""
        self.tell()
        self._last = None


@dataclass
class Resting:
    """Closes a server once its arm rests, and remembers whether it did; twice is allowed."""

    server: RobotServer
    before: Callable[[], None]
    after: Callable[[], None]
    rested: bool | None = None

    def close(self) -> None:
        if self.rested is not None:
            return
        self.before()
        self.after()
        self.rested = rests(self.server)
        self.server.close()


def rests(server: RobotServer) -> bool:
    end = time.monotonic() + PATIENCE
    while not server.robot.posture.at_rest and time.monotonic() < end:
        time.sleep(0.01)
    return server.robot.posture.at_rest


def struck(fault: str, phase: str, runs: Path) -> Came:
    """Fold denim by the arm fci and let `fault` strike in `phase`."""
    strike, expected = STRIKES[fault]
    if fault == "killed parent":
        return _killed_parent(phase, runs)
    scenes: list[Scene] = []
    ends: list[Resting] = []
    again: list[str] = []
    striker = Striker(phase, lambda: strike(scenes[0]))

    request = _request(runs)
    devices = _open(request)
    server = next(other for other in devices.others if isinstance(other, RobotServer))
    ends.append(Resting(server, striker.end, lambda: again.append(_next_time(fault, server))))
    scenes.append(Scene(devices, server, lambda: devices.arm._bridge))
    others = tuple(ends[0] if other is server else other for other in devices.others)
    devices = replace(devices, others=others)
    result = fold_with(devices, make_policy("triangular"), request, (striker,))
    outcome = ", then ".join(filter(None, [result.outcome, *again]))
    whole = read_run(Path(result.run)).result.outcome == result.outcome
    return Came(fault, phase, outcome, expected, bool(ends[0].rested), whole, striker.hang)


def _next_time(fault: str, server: RobotServer) -> str:
    """What the next one to connect is told, where that is the question."""
    if fault != "wrong version":
        return ""
    settings = find_configs(None).cell()
    fci = settings.fci.model_copy(update={"realtime": "ignore"})
    try:
        Bridge(Task(server.address, fci, settings.installation, None)).close()
    except Fault as refused:
        return refused.name if "9" in refused.reason and "10" in refused.reason else "unnamed"
    return "connected"


def _request(runs: Path, **fci: object) -> Request:
    """A fold by the arm fci, with other settings of `fci`."""
    choice, record = DeviceSelection(arm="fci", seed=3), Recording("none")
    request = request_for("denim", "triangular", runs, choice=choice, record=record)
    changed = request.cell.fci.model_copy(update=fci)
    return replace(request, cell=request.cell.model_copy(update={"fci": changed}))


def _open(request: Request) -> Devices:
    return open_cell(request.settings, request.strip, request.choice, calibrating=False)


def _killed_parent(phase: str, runs: Path) -> Came:
    """A fold in a process of its own, killed in `phase`; the robot lives on in this one."""
    settings = find_configs(None).cell()
    installation = settings.fci.limit(settings.installation)
    start = start_joints(installation, settings.fold, 0.6, settings.twin.arm.home_height)
    with RobotServer(ServerSettings(), start=frozen(start), between=lambda: 0.001) as server:
        server.hand.width = settings.fci.hand.opening
        command = [sys.executable, "-m", "tests.support.arm_faults", server.address, phase]
        victim = subprocess.Popen([*command, str(runs)], stdout=subprocess.PIPE, text=True)
        victim.stdout.readline()
        victim.kill()
        begun = time.perf_counter()
        while server.robot.motion is not None and time.perf_counter() - begun < 3:
            time.sleep(0.01)
        hang = time.perf_counter() - begun
        victim.communicate()
        run = read_run(max(runs.iterdir(), key=lambda folder: folder.stat().st_mtime))
        outcome = DIED if run.died and run.result is None else "told an end"
        return Came("killed parent", phase, outcome, (DIED,), rests(server), True, hang)


def _victim(address: str, phase: str, runs: Path) -> None:
    """Fold until `phase`, say so, and go on."""
    request = _request(runs, address=address, lock_step=True)
    striker = Striker(phase, lambda: print("here", flush=True))
    try:
        fold_with(_open(request), make_policy("triangular"), request, (striker,))
    except CellError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    _victim(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
