"""Control loop of a run: sense, decide, check, command and record at the control
rate.
"""

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from enum import Enum
from functools import partial
from types import FrameType
from typing import Protocol, TypeVar

from cell.base.devices.devices import ArmHistory, Devices
from cell.orchestrator.context import Inputs, Log
from cell.orchestrator.monitors import Rules, check_all, slow_for_images
from cell.orchestrator.outcome import INTERRUPTED, Outcome
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.safe_stop import SafeStop, run_suppressed
from cell.orchestrator.snapshot import (
    CloseHand,
    Command,
    Drive,
    Hold,
    MoveTo,
    OpenHand,
    Snapshot,
)
from cell.orchestrator.states import Machine, State, Trigger
from cell.orchestrator.steps import Phase
from cell.orchestrator.vision import MEASURED_STATES, RECORDED, View, Vision
from drivers.base.errors import Fault
from drivers.base.types import ZERO_VELOCITY

Given = TypeVar("Given", bound=Inputs)
Found = TypeVar("Found", bound=Log)
# s of computing for a control cycle on the wall clock; the setting may be lower
CYCLE_LIMIT = 1.0


class Observer(Protocol):
    """Protocol of an observer of a run, such as the live view; it must not block or
    fail.
    """

    def handle_tick(self, snapshot: Snapshot) -> None:
        """Receive the state of the cell at a tick; called on every tick."""

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """Receive an event at `time` [s] of the cell's clock; called for every
        event.
        """


class LoopStage(Enum):
    """Stages of a control loop: its phases give commands, the arm brakes, the arm
    rests.
    """

    UNDER_WAY = "under way"
    BRAKING = "braking"
    RESTING = "resting"


class ControlLoop:
    """Control loop of one run, which drives the devices through its states and records
    it.
    """

    def __init__(
        self,
        devices: Devices,
        inputs: Given,
        log: Found,
        phases: Mapping[State, Callable[[Given, Found, Recorder, Snapshot], Phase]],
        recorder: Recorder,
        observers: tuple[Observer, ...] = (),
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        """Prepare to drive `devices` by `phases`, functions of `inputs` and `log`,
        until the run ends.
        """
        self._devices = devices
        self._inputs = inputs
        self._log = log
        self._phases = {
            state: partial(phase, inputs, log) for state, phase in phases.items()
        }
        self._recorder = recorder
        self._observers = observers
        self._interrupted = interrupted
        settings = inputs.settings
        self._rules = Rules(
            limits=settings.monitors,
            workspace=settings.installation.workspace,
            desk=inputs.desk_end,
            motion=settings.installation.limits,
        )
        self._machine = Machine()
        self._entered = 0.0
        self._phase: Phase | None = None
        self._stage = LoopStage.UNDER_WAY
        self._command: Command | None = None
        self._stopped: Outcome | None = None
        braking_cycles = round(settings.fold.stop_timeout * settings.fold.control_rate)
        self._safe_stop = SafeStop(devices, braking_cycles)
        self._snapshot: Snapshot | None = None
        self._arm_history = ArmHistory()
        self._vision = Vision(devices.camera, settings.monitors, inputs.reader)
        self._velocity = ZERO_VELOCITY
        self._closed = False

    def execute(self) -> Outcome:
        """Carry out the run until the arm rests, and return its outcome; errors become
        outcomes.
        """
        clock = self._devices.clock
        period = 1.0 / self._inputs.settings.fold.control_rate
        start = clock.now()
        tick = 0
        try:
            self._guard(lambda: self._apply_event(Trigger.START, start))
            while self._stage is not LoopStage.RESTING:
                tick += 1
                self._run_cycle(start + tick * period)
        finally:
            if self._stopped is None:
                self._stop_devices()
            run_suppressed(self._devices.arm.stop)  # once more, however the run ended
        return self._outcome(clock.now() - start)

    def _guard(self, action: Callable[[], None]) -> None:
        """Carry out `action`; any exception in it stops the arm."""
        try:
            action()
        except Exception as error:  # noqa: BLE001  an edge: the arm stops whatever went wrong
            self._stop(Outcome.from_error(error))

    def _run_cycle(self, due: float) -> None:
        """Execute the cycle of the control loop due at `due` [s]."""
        if self._stage is LoopStage.UNDER_WAY and self._interrupted():
            self._stop(INTERRUPTED)
        if self._stage is LoopStage.UNDER_WAY:
            self._guard(lambda: self._limited_cycle(due))
        else:
            self._brake(due)

    def _limited_cycle(self, due: float) -> None:
        """Execute a cycle within the limit of its computing time."""
        limit = self._rules.limits.turn
        if self._devices.real_time:
            limit = min(limit, CYCLE_LIMIT)
        with time_limit(limit):
            self._cycle(due)

    def _cycle(self, due: float) -> None:
        """Carry out one cycle of the control loop: sense, decide, check,
        send, record.
        """
        self._devices.clock.wait_until(due)
        snapshot = self._sense()
        command = self._decide(snapshot)
        if command is not None:
            now = replace(snapshot, state=self._machine.state, entered=self._entered)
            command = slow_for_images(command, now, self._rules.limits)
            check_all(now, command, self._rules)
            self._send(command)
        elif snapshot.arm.moving:  # the path ended, and no phase follows
            self._stage = LoopStage.BRAKING
            self._safe_stop.apply(snapshot.hand)
        else:
            self._stage = LoopStage.RESTING
        self._recorder.tick(snapshot)
        self._notify(lambda observer: observer.handle_tick(snapshot))

    def _decide(self, snapshot: Snapshot) -> Command | None:
        """Command of the present phase or of its successor; None once the run is
        over.
        """
        try:
            if self._phase is not None:
                return self._phase.send(snapshot)
            self._phase = self._phases[self._machine.state](self._recorder, snapshot)
            return next(self._phase)
        except StopIteration as end:
            self._apply_event(end.value, snapshot.time)
        return None if self._machine.over else self._decide(snapshot)

    def _brake(self, due: float) -> None:
        """Carry out one full cycle of braking, even a late one, and record and show it
        where possible.
        """
        now = self._devices.clock.now()
        if now >= due:
            due = now + 1.0 / self._inputs.settings.fold.control_rate
        arm = self._safe_stop.brake_one_cycle(due)
        if arm is not None and self._snapshot is not None:
            view = replace(self._snapshot.view, fresh=False, read=False)
            self._snapshot = snapshot = replace(
                self._snapshot,
                time=arm.arrival,
                state=self._machine.state,
                arm=arm,
                view=view,
            )
            run_suppressed(lambda: self._recorder.tick(snapshot))
            self._notify(lambda observer: observer.handle_tick(snapshot))
        if not self._safe_stop.has_ended(arm):
            return
        self._stage = LoopStage.RESTING
        if not self._machine.over:
            run_suppressed(
                lambda: self._apply_event(Trigger.STOPPED, self._devices.clock.now())
            )

    def _apply_event(self, event: Trigger, now: float) -> None:
        """Apply an event to the state machine and record it; the lift starts measured
        time.
        """
        state = self._machine.apply(event)
        self._entered = now
        if state is State.LIFT:
            self._recorder.begin(now)
        self._record_event(now, "state", state=state, event=event)
        self._phase = None

    def _stop(self, stopped: Outcome) -> None:
        """Brake the arm and enter the state STOPPING for the reason `stopped`; a run
        that is over keeps its state.
        """
        self._stop_devices()
        self._stopped = stopped
        self._stage = LoopStage.BRAKING
        if not self._machine.over:
            self._entered = now = self._devices.clock.now()
            state = self._machine.apply(Trigger.STOP)
            facts = {"name": stopped.name, "reason": stopped.reason}
            run_suppressed(lambda: self._record_event(now, "fault", **facts))
            run_suppressed(
                lambda: self._record_event(
                    now, "state", state=state, event=Trigger.STOP
                )
            )

    def _stop_devices(self) -> None:
        """Stop the arm, and fingers that move or were sent a command since their last
        state.
        """
        seen = (
            None if isinstance(self._command, OpenHand | CloseHand) else self._snapshot
        )
        self._safe_stop.apply(None if seen is None else seen.hand)

    def _record_event(self, now: float, kind: str, **facts: object) -> None:
        self._recorder.event(now, kind, **facts)
        self._notify(lambda observer: observer.handle_event(now, kind, facts))

    def _notify(self, call: Callable[[Observer], None]) -> None:
        """Call `call` for all observers; one that raises is not called again."""
        self._observers = tuple(
            o
            for o in self._observers
            if run_suppressed(lambda: call(o))  # noqa: B023
        )

    def _sense(self) -> Snapshot:
        """Read arm, camera and hand, and record a new image with its measurement."""
        state = self._machine.state
        arm = self._devices.arm.state()
        self._arm_history.add(arm)
        now = self._devices.clock.now()
        view = self._vision.update(state, now, self._arm_history)
        self._record(view, state)
        self._snapshot = Snapshot(
            time=now,
            state=state,
            entered=self._entered,
            arm=arm,
            hand=self._devices.hand.state(),
            view=view,
            velocity=self._velocity,
            predicted=self._log.predicted,
            closed=self._closed,
        )
        return self._snapshot

    def _record(self, view: View, state: State) -> None:
        """Record the measurement and the image in `view` that are new."""
        if view.read and state in MEASURED_STATES and view.measurement is not None:
            self._recorder.sight(view.measurement)
        if view.fresh and state in RECORDED and view.frame is not None:
            self._recorder.frame(view.frame)

    def _send(self, command: Command) -> None:
        """Send `command` to its device, unless the same command is already
        under way.
        """
        arm = self._devices.arm
        hand = self._devices.hand
        if isinstance(command, Drive):
            arm.set_velocity(command.velocity)
            self._velocity = command.velocity
        elif command != self._command:
            match command:
                case MoveTo(pose):
                    arm.move_to(pose)
                case Hold():
                    arm.stop()
                case OpenHand(width):
                    hand.open(width)
                    self._closed = False
                case CloseHand():
                    hand.grasp()
                    self._closed = True
        self._command = command

    def _outcome(self, duration: float) -> Outcome:
        """Outcome of the ended run of `duration` [s], with the time of its touch in
        measured time.
        """
        log = self._log
        end = self._stopped or log.completion()
        touch = log.seen_touch
        if touch is not None:
            touch = replace(touch, time=touch.time - self._recorder.origin)
        return replace(
            end,
            touch=touch,
            edge_offset=log.edge_offset,
            duration=duration,
            predicted=log.predicted,
            witnesses=tuple(log.witnesses),
        )


@contextmanager
def time_limit(limit: float) -> Iterator[None]:
    """Raise Fault `turn_overtime` within the block once it takes longer than `limit`
    [s].

    Uses SIGALRM, so it has no effect outside the main thread, and does not end code
    that never returns to the interpreter; there the arm's driver brakes, for want of
    the cell's heartbeat.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    overtime = Fault(
        "turn_overtime", f"a turn of the control loop takes longer than {limit:g} s"
    )
    expired = threading.Event()

    def expire(_number: int, _frame: FrameType | None) -> None:
        expired.set()
        raise overtime

    before = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    # what was called, such as an observer or a plug-in, has suppressed it
    if expired.is_set():
        raise overtime
