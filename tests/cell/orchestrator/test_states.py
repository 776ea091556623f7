import pytest

from cell.orchestrator.states import TERMINAL, TRANSITIONS, Machine, State, Trigger
from drivers.base.errors import Fault


def test_every_state_can_be_stopped_and_no_stop_resumes() -> None:
    for state in State:
        if state in TERMINAL or state is State.STOPPING:
            continue
        assert TRANSITIONS[state, Trigger.STOP] is State.STOPPING
    leaving = {
        event: to
        for (origin, event), to in TRANSITIONS.items()
        if origin is State.STOPPING
    }
    assert leaving == {Trigger.STOPPED: State.FAULT}
    assert not any(origin in TERMINAL for origin, _ in TRANSITIONS)


def test_an_event_that_has_no_transition_names_those_that_have() -> None:
    with pytest.raises(
        Fault, match="laid in state IDLE; allowed here: start, stop"
    ) as refused:
        Machine().apply(Trigger.LAID)
    assert refused.value.name == "illegal_event"
