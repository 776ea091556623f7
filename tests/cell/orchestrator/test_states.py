from cell.orchestrator.states import TERMINAL, TRANSITIONS, Event, State


def test_every_state_can_be_stopped_and_no_stop_resumes() -> None:
    for state in State:
        if state in TERMINAL or state is State.STOPPING:
            continue
        assert TRANSITIONS[state, Event.STOP] is State.STOPPING
    leaving = {event: to for (origin, event), to in TRANSITIONS.items() if origin is State.STOPPING}
    assert leaving == {Event.STOPPED: State.FAULT}
    assert not any(origin in TERMINAL for origin, _ in TRANSITIONS)
