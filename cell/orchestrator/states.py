"""State machine of a run: states, events and allowed transitions."""

from enum import StrEnum

from drivers.base.errors import Fault


class State(StrEnum):
    """States of a run's state machine."""

    IDLE = "IDLE"
    PREFLIGHT = "PREFLIGHT"
    CALIBRATE = "CALIBRATE"
    GRASP = "GRASP"
    LIFT = "LIFT"
    FOLD = "FOLD"
    TOUCHED = "TOUCHED"
    LAY = "LAY"
    RELEASE = "RELEASE"
    DONE = "DONE"
    STOPPING = "STOPPING"
    FAULT = "FAULT"


class Trigger(StrEnum):
    """Events that change the state of a run."""

    START = "start"
    NEEDS_CALIBRATION = "needs_calibration"
    CALIBRATED = "calibrated"
    CHECKED = "checked"
    GRASPED = "grasped"
    LIFTED = "lifted"
    LAYER_TOUCH = "layer_touch"
    PATH_DONE = "path_done"
    SETTLED = "settled"
    LAID = "laid"
    RELEASED = "released"
    MOVED = "moved"
    STOP = "stop"
    STOPPED = "stopped"


TERMINAL = frozenset({State.DONE, State.FAULT})

_FORWARD: dict[tuple[State, Trigger], State] = {
    (State.IDLE, Trigger.START): State.PREFLIGHT,
    (State.PREFLIGHT, Trigger.NEEDS_CALIBRATION): State.CALIBRATE,
    (State.CALIBRATE, Trigger.CALIBRATED): State.DONE,
    (State.PREFLIGHT, Trigger.MOVED): State.DONE,
    (State.PREFLIGHT, Trigger.CHECKED): State.GRASP,
    (State.GRASP, Trigger.GRASPED): State.LIFT,
    (State.LIFT, Trigger.LIFTED): State.FOLD,
    (State.LIFT, Trigger.PATH_DONE): State.DONE,
    (State.FOLD, Trigger.LAYER_TOUCH): State.TOUCHED,
    (State.FOLD, Trigger.PATH_DONE): State.DONE,
    (State.TOUCHED, Trigger.SETTLED): State.LAY,
    (State.LAY, Trigger.LAID): State.RELEASE,
    (State.RELEASE, Trigger.RELEASED): State.DONE,
    (State.STOPPING, Trigger.STOPPED): State.FAULT,
}
_STOPS = {
    (state, Trigger.STOP): State.STOPPING
    for state in State
    if state not in {*TERMINAL, State.STOPPING}
}
TRANSITIONS: dict[tuple[State, Trigger], State] = {**_FORWARD, **_STOPS}


class Machine:
    """State machine of a run; its `state` changes only by the events in TRANSITIONS."""

    def __init__(self) -> None:
        self.state = State.IDLE

    def apply(self, event: Trigger) -> State:
        """Apply `event` and return the new state; raises Fault for an event that the
        present state does not allow.
        """
        try:
            self.state = TRANSITIONS[self.state, event]
        except KeyError:
            allowed = ", ".join(e for s, e in TRANSITIONS if s is self.state) or "none"
            raise Fault(
                "illegal_event",
                f"{event} in state {self.state}; allowed here: {allowed}",
            ) from None
        return self.state

    @property
    def over(self) -> bool:
        """Whether the run has ended, in DONE or in FAULT."""
        return self.state in TERMINAL
