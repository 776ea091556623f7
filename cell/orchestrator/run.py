"""One run: senses, monitors, command, record, at the control rate, until the run is over."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from calibration.perception.sanity import ImageSanity
from calibration.perception.sight import SeenTouch, Sight
from cell.devices.devices import Devices
from cell.orchestrator.context import Knowledge
from cell.orchestrator.monitors import Rules, check_all
from cell.orchestrator.outcome import INTERRUPTED, Outcome, Stopped
from cell.orchestrator.phases import PHASES
from cell.orchestrator.recorder import Record
from cell.orchestrator.safe_stop import Brakes, attempt
from cell.orchestrator.snapshot import CloseHand, Command, Drive, Hold, MoveTo, OpenHand, Senses
from cell.orchestrator.states import Event, Machine, State
from cell.orchestrator.steps import Phase
from drivers.errors import Fault
from drivers.types import ArmState, Frame, Pose

HISTORY = 64  # arm states kept to know where the gripper was when an image was taken
LOOKING = frozenset({State.LIFT, State.FOLD, State.TOUCHED})
SHOWN = frozenset({State.LAY, State.RELEASE})
GLANCE = 0.1  # s between images where nothing is read from them


class Observer(Protocol):
    """Someone who watches a run: the live view, the progress bar. Never blocks, never fails."""

    def see(self, senses: Senses) -> None:
        """One tick."""
        ...

    def happened(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """One event."""
        ...


class Run:
    """Drives the devices through the states of one fold and records everything."""

    def __init__(
        self,
        devices: Devices,
        knowledge: Knowledge,
        recorder: Record,
        observers: tuple[Observer, ...] = (),
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        self._devices = devices
        self._cell = knowledge
        self._recorder = recorder
        self._observers = observers
        self._interrupted = interrupted
        settings = knowledge.settings
        self._rules = Rules(settings.monitors, settings.installation.workspace)
        self._machine = Machine()
        self._entered = 0.0
        self._phase: Phase = _nothing()
        self._started = False
        self._rests = False
        self._command: Command | None = None
        self._stopped: Stopped | None = None
        self._brakes = Brakes(
            devices, round(settings.fold.stop_timeout * settings.fold.control_rate)
        )
        self._senses: Senses | None = None
        self._sanity = ImageSanity()
        self._arm_history: list[ArmState] = []
        self._frame: Frame | None = None
        self._identical = 1
        self._sight: Sight | None = None
        self._touch: SeenTouch | None = None
        self._doubtful_since: float | None = None

    def execute(self) -> Outcome:
        """Run to DONE or FAULT, and until the arm says that it rests or has had its time for it.

        Whatever goes wrong in a turn stops the arm first.
        """
        clock = self._devices.clock
        period = 1.0 / self._cell.settings.fold.control_rate
        start, tick = clock.now(), 0
        try:
            self._guarded(lambda: self._take(Event.START, start))
            while not (self._machine.over and self._rests):
                tick += 1
                self._turn_at(start + tick * period)
        finally:
            attempt(self._devices.arm.stop)
        return self._outcome(clock.now() - start)

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception as error:  # noqa: BLE001  an edge: the arm stops whatever went wrong
            self._stop(Stopped.by(error))

    def _turn_at(self, due: float) -> None:
        """The turn of the loop at `due` [s]."""
        if self._under_way and self._interrupted():
            self._stop(INTERRUPTED)
        if self._under_way:
            self._guarded(lambda: self._turn(due))
        else:
            self._brake(due)

    @property
    def _under_way(self) -> bool:
        return self._stopped is None and not self._machine.over

    def _turn(self, due: float) -> None:
        self._devices.clock.wait_until(due)
        begun = time.perf_counter()
        senses = self._sense()
        command = self._decide(senses)
        if command is not None:
            now = replace(senses, state=self._machine.state, entered=self._entered)
            check_all(now, command, self._rules)
            self._send(command)
        elif senses.arm.moving:  # the path ended, and nothing came after it
            self._brakes.apply(senses.hand)
        else:
            self._rests = True
        self._recorder.tick(senses, time.perf_counter() - begun)
        self._show(lambda observer: observer.see(senses))

    def _decide(self, senses: Senses) -> Command | None:
        """The phase's next command; an ended phase hands over to that of the next state."""
        try:
            if self._started:
                return self._phase.send(senses)
            self._started = True
            return next(self._phase)
        except StopIteration as end:
            self._take(end.value, senses.time)
        return None if self._machine.over else self._decide(senses)

    def _brake(self, due: float) -> None:
        """One turn of braking; recorded and shown as far as that is possible."""
        arm = self._brakes.turn(due)
        if arm is not None and self._senses is not None:
            self._senses = senses = replace(
                self._senses, time=arm.arrival, state=self._machine.state, arm=arm, fresh=False
            )
            attempt(lambda: self._recorder.tick(senses, float("nan")))
            self._show(lambda observer: observer.see(senses))
        self._rests = self._brakes.ended(arm)
        if self._rests and not self._machine.over:
            attempt(lambda: self._take(Event.STOPPED, self._devices.clock.now()))

    def _take(self, event: Event, now: float) -> None:
        """Follow an event into the next state; the lift starts measured time."""
        state = self._machine.take(event)
        self._entered = now
        if state is State.LIFT:
            self._recorder.begin(now)
        self._note(now, "state", state=state, event=event)
        if state in PHASES:
            self._phase, self._started = PHASES[state](self._cell, self._recorder), False

    def _stop(self, stopped: Stopped) -> None:
        """Brake now; a run that is over already only ends otherwise."""
        self._brakes.apply(None if self._senses is None else self._senses.hand)
        self._stopped = stopped
        if not self._machine.over:
            self._entered = now = self._devices.clock.now()
            state = self._machine.take(Event.STOP)
            facts = {"name": stopped.name, "reason": stopped.reason}
            attempt(lambda: self._note(now, "fault", **facts))
            attempt(lambda: self._note(now, "state", state=state, event=Event.STOP))

    def _note(self, now: float, kind: str, **facts: object) -> None:
        self._recorder.event(now, kind, **facts)
        self._show(lambda observer: observer.happened(now, kind, facts))

    def _show(self, news: Callable[[Observer], None]) -> None:
        """Tell the observers; one that fails is told nothing more and holds nothing up."""
        self._observers = tuple(o for o in self._observers if attempt(lambda: news(o)))  # noqa: B023

    def _sense(self) -> Senses:
        arm = self._devices.arm.state()
        self._arm_history = [*self._arm_history[1 - HISTORY :], arm]
        fresh = self._look()
        self._senses = Senses(
            time=self._devices.clock.now(),
            state=self._machine.state,
            entered=self._entered,
            arm=arm,
            hand=self._devices.hand.state(),
            frame=self._frame,
            fresh=fresh,
            identical=self._identical,
            sight=self._sight,
            touch=self._touch,
            doubtful_since=self._doubtful_since,
        )
        return self._senses

    def _look(self) -> bool:
        """Take the newest image, if there is news, and read the strip in it."""
        looking = self._machine.state in LOOKING
        after = self._frame.stamp if self._frame is not None else -1.0
        frame = self._devices.camera.read(after if looking else after + GLANCE, timeout=0.0)
        if frame is None:
            return False
        self._frame = frame
        self._identical = self._sanity.tell(frame, self._devices.clock.now()).identical
        if looking:
            self._read(frame.restamped(-self._cell.latency))
        if looking or self._machine.state in SHOWN:
            self._recorder.frame(frame)
        return True

    def _read(self, frame: Frame) -> None:
        """What the image says of the strip, and whether the layers touch by now."""
        cell = self._cell
        if cell.perception is None or cell.touch is None:
            raise Fault("no_perception", "images are to be read before a picture was judged")
        gripper = self._pose_at(frame.stamp)
        self._sight = cell.perception.look(frame, gripper)
        self._recorder.sight(self._sight)
        self._judge(self._sight)
        if self._machine.state is not State.LIFT:
            self._touch = cell.touch.tell(self._sight, gripper)

    def _judge(self, sight: Sight) -> None:
        """Remember since when the images have not deserved confidence."""
        if sight.confidence >= self._cell.settings.monitors.confidence:
            self._doubtful_since = None
        elif self._doubtful_since is None:
            self._doubtful_since = sight.stamp

    def _pose_at(self, stamp: float) -> Pose:
        """Where the gripper was at `stamp`, between the arm's own readings."""
        times = np.array([state.stamp for state in self._arm_history])
        poses = np.array([state.pose.as_array() for state in self._arm_history])
        return Pose(*(float(np.interp(stamp, times, poses[:, axis])) for axis in range(3)))

    def _send(self, command: Command) -> None:
        """Give the command to its device; what is already under way is not repeated."""
        arm, hand = self._devices.arm, self._devices.hand
        if isinstance(command, Drive):
            arm.set_velocity(command.velocity)
            self._cell.velocity = command.velocity
        elif command != self._command:
            match command:
                case MoveTo(pose):
                    arm.move_to(pose)
                case Hold():
                    arm.stop()
                case OpenHand():
                    hand.open()
                case CloseHand():
                    hand.grasp()
        self._command = command

    def _outcome(self, duration: float) -> Outcome:
        cell, origin = self._cell, self._recorder.origin
        touch = cell.seen_touch
        if touch is not None:
            touch = replace(touch, time=touch.time - origin)
        if self._stopped is not None:
            name, reason, code = self._stopped.name, self._stopped.reason, self._stopped.exit_code
        elif touch is not None:
            name, reason, code = "layer_touch", "the layers touch", 0
        elif cell.touches is not None:
            name, reason, code = "calibrated", "all points were touched", 0
        else:
            name, reason, code = "path_done", "the path ended and no touch was seen", 1
        return Outcome(name, reason, code, touch, cell.edge_offset, duration)


def _nothing() -> Phase:
    """The phase of a state in which nothing is commanded."""
    while True:
        yield Hold()
