"""How punctual the control loop is on the wall clock, whatever an image costs.

python -m tests.lab measure-wall-clock [--folds 20] [--image 0.04] [--stops 5] [--idle-time 60]
    [--films 0]

An emulated robot runs by the wall clock in a process of its own and knows no strip. A fold of the
twin is recorded once; another process plays its images at 60 Hz, each where the gripper was when it
was taken. The cell folds with them as with a real camera: images are measured beside the loop and
made to cost `--image` seconds of processor time each. Printed are the lateness of the ticks, how
many folds got through, and the time from a cause to the stop command: the operator's, and the end
of the process that measures. The same loop without images, the robot held still for `--idle-time`
seconds, is the reference for this machine. After each of the first
`--films` folds comes one that keeps a film, as `cell fold` does; their ticks are counted apart.

Beside the figures stands what a virtual machine's host took of its processors meanwhile: while it
does, nothing of this machine runs, and a robot gives its loop up after 20 ms. And how many late
ticks followed a turn that itself took too long; the others were not woken in time.
"""

import gc
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

import cell.folding.fold
from calibration.calibration import Calibration
from cell.arm.run_settings import suit_to_arm
from cell.calibrating.calibrate import calibration_of
from cell.config.cell import CellFile
from cell.config.places import find_configs
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.fci import robot_devices, start_joints
from cell.devices.open import open_cell
from cell.folding.fold import fold_with
from cell.folding.request import Recording, Request
from cell.folding.steady import punctual
from cell.orchestrator.context import ManualContext
from cell.orchestrator.recorder import Record
from cell.orchestrator.run import Run
from cell.orchestrator.steps import pause
from drivers.arm.orders import Latest
from drivers.arm.process import Task
from drivers.arm.requests import go_to
from drivers.clock import WallClock, lock_memory, take_priority
from drivers.errors import Fault
from drivers.fci_server.server import RobotServer, ServerSettings
from drivers.types import ArmState, Frame, frozen
from policies.registry import make_policy
from tests.support.children import children
from tests.support.requests import request_for
from tests.support.sights import CostlySight

RATE = 60.0  # Hz, of the played images
AHEAD = 150  # images among which the one of a pose is looked for: more than a rest lasts
PLAYER = 30  # of 1 to 99, its priority
GAP = 1.0  # s without a state, after which another fold has begun
BAR, LATE, STOP = 99.9, 2e-3, 20e-3  # %, s, s
THIS = ("tests.lab", "measure-wall-clock")
LENGTH = 0.36  # m, of the strip: a short fold


class Place(NamedTuple):
    """Where the gripper was, for the player: stamp [s], x, z [m], pitch [rad]."""

    stamp: float
    x: float
    z: float
    pitch: float


class Shown(NamedTuple):
    """The image that is shown: its number since the start, its stamp, its place in the film."""

    number: int
    stamp: float
    index: int


PLACE, SHOWN = "dddd", "qdq"


@dataclass
class Film:
    """Images (n, h, w, 3) in a file, and the poses (n, 3) at which they were taken."""

    path: Path
    shape: tuple[int, int, int]
    poses: list[list[float]] = field(default_factory=list)

    def images(self) -> np.ndarray:
        return np.memmap(self.path, np.uint8, "r", shape=(len(self.poses), *self.shape))


class FilmingCamera:
    """Keeps every frame, also those that the cell leaves out, with the arm's pose then."""

    def __init__(self, camera, arm, film: Film) -> None:
        self._camera, self._arm, self._film = camera, arm, film
        self.rate, self.connect, self.close = camera.rate, camera.connect, camera.close
        self._file = film.path.open("wb")
        self._last: Frame | None = None

    def read(self, after: float, timeout: float) -> Frame | None:
        frame = self._camera.read(-1.0 if self._last is None else self._last.stamp, timeout)
        if frame is not None:
            self._last = frame
            pose = self._arm.state().pose
            self._film.poses.append(pose.as_array().tolist())
            self._file.write(np.ascontiguousarray(frame.image).data)
            self._file.flush()
        return self._last if self._last is not None and self._last.stamp > after else None


class PlayedCamera:
    """Delivers the image that the player shows; a bit of it differs, as no real image repeats."""

    rate = RATE

    def __init__(self, film: Film, shown: Latest, clock: WallClock) -> None:
        self._images, self._shown, self._clock = film.images(), shown, clock
        self._before = shown.read().number  # of the fold before, whose stamps are of another clock

    def connect(self) -> None:
        """The player plays already."""

    def close(self) -> None:
        """The player ends with the folds."""

    def read(self, after: float, timeout: float) -> Frame | None:
        shown = self._shown.read()
        if shown.number <= self._before or shown.stamp <= after:
            return None
        image = np.array(self._images[shown.index])
        image[0, 0, :2] = divmod(shown.number % 65536, 256)
        return Frame(shown.stamp, self._clock.now(), "film", shown.number, image)


def play(poses: list[list[float]], place: Latest[Place], shown: Latest[Shown]) -> None:
    """Show 60 images a second, each the one nearest to where the gripper is, never going back."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    take_priority(PLAYER)  # a camera waits for no processor
    film, index, number, last = np.array(poses), 0, 0, -1.0
    while True:
        time.sleep(1.0 / RATE)
        now = place.read()
        if not last <= now.stamp < last + GAP:
            index = 0
        if now.stamp == last or place.count == 0:
            continue
        last, number = now.stamp, number + 1
        part = film[index : index + AHEAD] - (now.x, now.z, now.pitch)
        away = np.hypot(part[:, 0], part[:, 1]) + 0.05 * np.abs(part[:, 2])
        index += int(np.argmin(away + 1e-5 * np.arange(len(part))))
        shown.write(Shown(number, now.stamp, index))


class TellingArm:
    """An arm whose states the player hears of, and that notes when it was stopped."""

    def __init__(self, arm, place: Latest) -> None:
        self._arm, self._place = arm, place
        self.connect, self.close = arm.connect, arm.close
        self.move_to, self.set_velocity = arm.move_to, arm.set_velocity
        self.stopped: list[float] = []

    def state(self) -> ArmState:
        state = self._arm.state()
        pose = state.pose
        self._place.write(Place(state.stamp, pose.x, pose.z, pose.pitch))
        return state

    def stop(self) -> None:
        self._arm.stop()
        self.stopped.append(time.monotonic())


class Late(NamedTuple):
    """When something was due, in the machine's time, by how much it came late [s], and whether it
    was waited for: else what came before took too long.
    """

    due: float
    by: float
    awaited: bool = True
    state: str = ""


class TimingClock(WallClock):
    """A wall clock that notes by how much each tick comes late."""

    def __init__(self) -> None:
        super().__init__()
        self.late: list[Late] = []
        self.state = ""

    def wait_until(self, time_s: float) -> None:
        awaited = self.now() < time_s
        super().wait_until(time_s)
        self.late.append(Late(self.origin + time_s, self.now() - time_s, awaited, self.state))


def taken() -> float:
    """Processor time that the host of a virtual machine has taken from it so far [s]."""
    ticks = Path("/proc/stat").read_text().split("\n", 1)[0].split()[8]
    return int(ticks) / os.sysconf("SC_CLK_TCK")


@dataclass
class Bench:
    """Everything that the folds share."""

    folder: Path
    settings: CellFile
    configs: Path
    calibration: Calibration
    address: str
    joints: list[float]
    film: Film
    place: Latest
    shown: Latest

    def devices(self, settings: CellFile, strip, clock: TimingClock) -> tuple[Devices, TellingArm]:
        camera = PlayedCamera(self.film, self.shown, clock)
        made = robot_devices(settings, strip, clock, camera)
        arm = TellingArm(made.arm, self.place)
        return replace(made, arm=arm, camera_identity=self.calibration.camera), arm

    def go_home(self) -> None:
        """Bring the robot to where a fold begins; what is lost on a busy machine is tried again."""
        fci = suit_to_arm(self.settings, DeviceSelection(arm="fci"))
        for _ in range(10):
            try:
                task = Task(self.address, fci.fci, fci.installation, 0.0)
                go_to(task, self.joints, 1.0, recover=True)
            except Fault as fault:
                sys.stderr.write(f"go home: {fault}\n")
            else:
                return
        raise SystemExit("the robot did not come home in ten tries")


def request(configs: Path, runs: Path, arm: str = "fci", film: bool = False) -> Request:
    record = Recording("none", "libx264" if film else None, truth=False, page=False)
    choice = DeviceSelection(arm=arm, seed=0)
    return request_for("denim", "triangular", runs, configs, choice=choice, record=record)


def one_fold(bench: Bench, cause=None, film: bool = False) -> tuple[str, list[Late], float]:
    """Outcome, lateness of the ticks and, with a `cause`, the time to the stop command [s].

    A cause strikes from a thread at a random moment of the fold, and returns when it did.
    """
    clock, arms = TimingClock(), []
    asked, struck = threading.Event(), []

    class Watch:
        state, pose = "", None

        def see(self, snapshot) -> None:
            self.pose = snapshot.arm.pose

        def handle_event(self, _time, kind, facts) -> None:
            if kind == "state" and facts["state"] not in ("STOPPING", "FAULT", "DONE"):
                self.state = clock.state = facts["state"]
            if kind == "state" and facts["state"] == "FOLD" and cause is not None:
                wait = np.random.default_rng().uniform(0.3, 1.3)
                threading.Timer(wait, lambda: struck.append(cause(asked))).start()

    watch = Watch()
    wanted = request(bench.configs, bench.folder / "runs", film=film)
    devices, arm = bench.devices(wanted.settings, wanted.strip, clock)
    arms.append(arm)
    cell.folding.fold.StripSight = CostlySight
    policy = make_policy(wanted.policy)
    result = fold_with(devices, policy, wanted, (watch,), asked.is_set, bench.calibration)
    after = [at - struck[0] for at in arms[0].stopped if struck and at > struck[0]]
    return (
        f"{result.outcome} in {watch.state} at {watch.pose}: {result.reason}",
        clock.late,
        min(after, default=float("nan")),
    )


def interrupt(asked: threading.Event) -> float:
    begun = time.monotonic()
    asked.set()
    return begun


def kill_reader(_: threading.Event) -> float:
    """Kill the process that measures."""
    (reader,) = children("perception.sight")
    begun = time.monotonic()
    os.kill(reader, signal.SIGKILL)
    return begun


def idle(bench: Bench, seconds: float) -> list[Late]:
    """Lateness of the same loop with the robot held still and no image read."""
    clock = TimingClock()
    settings = suit_to_arm(bench.settings, DeviceSelection(arm="fci"))
    limits = settings.monitors.model_copy(update={"duration": 900.0, "state_duration": 300.0})
    settings = settings.model_copy(update={"monitors": limits})
    devices, _ = bench.devices(settings, find_configs(bench.configs).strip("denim"), clock)
    context = ManualContext(settings.controller, lambda _: pause(seconds))
    try:
        devices.connect()
        with punctual(True):
            outcome = Run(devices, context, Record()).execute()
    finally:
        devices.close()
    sys.stderr.write(f"idle: {outcome.name}: {outcome.reason}\n")
    return clock.late


def recorded(configs: Path, folder: Path, calibration: Calibration) -> Film:
    """Film of a fold of the twin in lock-step, along the same path."""
    lens = calibration.lens
    film = Film(folder / "film", (lens.height, lens.width, 3))

    wanted = request(configs, folder / "recorded", "twin")
    devices = open_cell(wanted.settings, wanted.strip, wanted.choice, calibrating=False)
    devices = replace(devices, camera=FilmingCamera(devices.camera, devices.arm, film))
    made = fold_with(devices, make_policy(wanted.policy), wanted, calibration=calibration)
    sys.stderr.write(f"recorded: {made.outcome}, {len(film.poses)} images\n")
    return film


def serve(joints: list[float]) -> None:
    """Be the robot, by the wall clock, until killed."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))
    server = RobotServer(
        ServerSettings(lock_step=False), start=frozen(joints), between=lambda: 0.001
    )
    lock_memory()
    gc.collect()
    gc.freeze()  # a robot collects no garbage
    print(server.address, flush=True)
    server.serve()


@contextmanager
def robot(joints: list[float]) -> Iterator[str]:
    command = [sys.executable, "-m", *THIS, "--serve-at", json.dumps(joints)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield server.stdout.readline().strip()
        finally:
            server.kill()


def configured(folder: Path, address: str) -> Path:
    from cell.record.documents import write_document

    usual, made = find_configs(None), folder / "configs"
    (made / "strips").mkdir(parents=True)
    content = usual.cell().model_dump(mode="json", by_alias=True, exclude_unset=True)
    content["fci"] = {"address": address, "lock_step": False, "realtime": "priority"}
    write_document(made / "cell.yaml", content)
    strip = usual.strip("denim").model_dump(mode="json", by_alias=True, exclude_unset=True)
    write_document(made / "strips" / "denim.yaml", strip | {"length": LENGTH, "spread": {}})
    return made


@contextmanager
def bench() -> Iterator[Bench]:
    usual = find_configs(None).cell()
    installation = usual.fci.limit(usual.installation)
    joints = list(start_joints(installation, usual.fold, LENGTH, usual.twin.arm.home_height))
    memory = Path("/dev/shm")  # noqa: S108  a film on disk would be waited for
    home = memory if memory.is_dir() else None
    with tempfile.TemporaryDirectory(dir=home) as home_folder, robot(joints) as address:
        folder = Path(home_folder)
        configs = configured(folder, address)
        calibration = calibration_of(find_configs(configs).cell())
        film = recorded(configs, folder, calibration)
        place, shown = Latest(Place), Latest(Shown)
        fork = get_context("fork")  # which inherits the memory
        player = fork.Process(target=play, args=(film.poses, place, shown), daemon=True)
        player.start()
        try:
            yield Bench(
                folder, find_configs(configs).cell(), configs, calibration, address, joints, film,
                place, shown,
            )  # fmt: skip
        finally:
            player.kill()


def told(name: str, late: list[Late], stolen: float) -> bool:
    """Print the lateness of ticks, and for how long the host had `stolen` a processor [s]; whether
    it keeps its bar.
    """
    if not late:
        print(f"{name}: no tick was made", flush=True)
        return False
    some = 1e3 * np.array([tick.by for tick in late])
    share = 100.0 * float((some <= 1e3 * LATE).mean())
    words = f"{len(some)} ticks, {share:.2f} % at most {1e3 * LATE:g} ms late (bar {BAR})"
    edges = ", ".join(f"{p} %: {np.percentile(some, p):.2f} ms" for p in (50, 99, 99.9, 100))
    slow = [tick for tick in late if tick.by > LATE]
    after = f"{sum(not tick.awaited for tick in slow)} of {len(slow)} after a turn too long"
    states = Counter(tick.state for tick in slow)
    after += "".join(f", {state} {count}" for state, count in states.most_common() if state)
    print(f"{name}: {words}; {edges}; {after}; host took {stolen:.2f} s", flush=True)
    return share >= BAR


def main(
    folds: int = 20,
    image: float = 0.04,
    stops: int = 5,
    films: int = 0,
    idle_time: float = 60.0,
    serve_at: str = "",
) -> int:
    """Fold and stop on the wall clock; or serve the robot at these joints."""
    if serve_at:
        serve(json.loads(serve_at))
    os.environ["IMAGE_COST"] = str(image)
    late, through, kept, filmed = [], 0, True, []
    with bench() as table:
        table.go_home()
        begun = taken()
        told("without images", idle(table, idle_time), taken() - begun)
        begun = taken()
        for number in range(folds):
            table.go_home()
            outcome, more, _ = one_fold(table)
            late, through = late + more, through + outcome.startswith("layer_touch")
            sys.stderr.write(f"{outcome}\n")
            if number < films:
                table.go_home()
                outcome, more, _ = one_fold(table, film=True)
                filmed += more
                sys.stderr.write(f"with a film: {outcome}\n")
        if filmed:
            told("the same with a film", filmed, taken() - begun)
        if folds:
            kept = told(f"images of {1e3 * image:g} ms", late, taken() - begun)
            print(f"{through} of {folds} folds got through", flush=True)
        for name, cause in (("operator", interrupt), ("reader killed", kill_reader)):
            times = []
            for _ in range(stops):
                table.go_home()
                outcome, _, after = one_fold(table, cause)
                times.append(1e3 * after)
                sys.stderr.write(f"{outcome}: {1e3 * after:.1f} ms\n")
            print(f"stop after {name}: {', '.join(f'{t:.1f}' for t in times)} ms (bar 20)")
            kept = kept and max(times, default=0.0) <= 1e3 * STOP
    return 0 if kept and through == folds else 1
