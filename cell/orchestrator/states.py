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


class Event(StrEnum):
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

_FORWARD: dict[tuple[State, Event], State] = {
    (State.IDLE, Event.START): State.PREFLIGHT,
    (State.PREFLIGHT, Event.NEEDS_CALIBRATION): State.CALIBRATE,
    (State.CALIBRATE, Event.CALIBRATED): State.DONE,
    (State.PREFLIGHT, Event.MOVED): State.DONE,
    (State.PREFLIGHT, Event.CHECKED): State.GRASP,
    (State.GRASP, Event.GRASPED): State.LIFT,
    (State.LIFT, Event.LIFTED): State.FOLD,
    (State.LIFT, Event.PATH_DONE): State.DONE,
    (State.FOLD, Event.LAYER_TOUCH): State.TOUCHED,
    (State.FOLD, Event.PATH_DONE): State.DONE,
    (State.TOUCHED, Event.SETTLED): State.LAY,
    (State.LAY, Event.LAID): State.RELEASE,
    (State.RELEASE, Event.RELEASED): State.DONE,
    (State.STOPPING, Event.STOPPED): State.FAULT,
}
_STOPS = {
    (state, Event.STOP): State.STOPPING
    for state in State
    if state not in {*TERMINAL, State.STOPPING}
}
TRANSITIONS: dict[tuple[State, Event], State] = {**_FORWARD, **_STOPS}


class Machine:
    """State machine of a run; its `state` changes only by the events in TRANSITIONS."""

    def __init__(self) -> None:
        self.state = State.IDLE

    def apply(self, event: Event) -> State:
        """Apply `event`, return the new state; raises Fault for an event that is not
        allowed.
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
