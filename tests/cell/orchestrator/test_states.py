import itertools

import pytest

from cell.orchestrator.states import TERMINAL, TRANSITIONS, Event, Machine, State
from drivers.errors import Fault


def test_a_fold_passes_through_the_states_in_order() -> None:
    machine = Machine()
    path = [
        machine.take(event)
        for event in (
            Event.START,
            Event.CHECKED,
            Event.GRASPED,
            Event.LIFTED,
            Event.LAYER_TOUCH,
            Event.SETTLED,
            Event.LAID,
            Event.RELEASED,
        )
    ]
    assert path == [
        State.PREFLIGHT,
        State.GRASP,
        State.LIFT,
        State.FOLD,
        State.TOUCHED,
        State.LAY,
        State.RELEASE,
        State.DONE,
    ]
    assert machine.over


@pytest.mark.parametrize(("state", "event"), list(itertools.product(State, Event)))
def test_an_event_without_a_transition_is_an_error(state: State, event: Event) -> None:
    machine = Machine()
    machine.state = state
    if (state, event) in TRANSITIONS:
        assert machine.take(event) is TRANSITIONS[state, event]
        return
    with pytest.raises(Fault, match="illegal_event"):
        machine.take(event)
    assert machine.state is state


def test_every_state_can_be_stopped_and_no_stop_resumes() -> None:
    for state in State:
        if state in TERMINAL or state is State.STOPPING:
            continue
        assert TRANSITIONS[state, Event.STOP] is State.STOPPING
    leaving = {event: to for (origin, event), to in TRANSITIONS.items() if origin is State.STOPPING}
    assert leaving == {Event.STOPPED: State.FAULT}
    assert not any(origin in TERMINAL for origin, _ in TRANSITIONS)
