"""What every hand must do, simulated or real."""

import pytest

from drivers.base.types import HandState, Pose


def until_still(bench, limit: float = 5.0) -> HandState:
    clock = bench.clock
    end = clock.now() + limit
    while clock.now() < end:
        clock.wait_until(clock.now() + 0.01)
        state = bench.hand.state()
        if not state.moving:
            return state
    pytest.fail(f"the hand still moves after {limit} s")


def _arrive(bench) -> None:
    while bench.arm.state().moving:
        bench.clock.wait_until(bench.clock.now() + 0.01)


def _grasped(bench) -> HandState:
    bench.hand.grasp()
    return until_still(bench)


@pytest.fixture
def at_edge(bench):
    """The bench with its open hand about the strip's edge."""
    bench.arm.connect()
    bench.arm.move_to(bench.edge)
    _arrive(bench)
    return bench


def test_hand_begins_open_still_and_empty(bench) -> None:
    state = bench.hand.state()
    assert state.width > 0.01
    assert not state.moving
    assert not state.grasped


def test_states_are_never_stamped_after_their_arrival(bench) -> None:
    bench.hand.grasp()
    for _ in range(10):
        bench.clock.wait_until(bench.clock.now() + 0.03)
        state = bench.hand.state()
        assert state.stamp <= state.arrival <= bench.clock.now()
        assert state.source


def test_grasp_of_an_edge_between_the_fingers_holds(at_edge) -> None:
    at_edge.hand.grasp()
    assert at_edge.hand.state().moving
    assert not at_edge.hand.state().grasped
    state = until_still(at_edge)
    assert state.grasped
    assert 0 < state.width < 0.01


def test_grasp_in_the_air_does_not_hold(bench) -> None:
    state = _grasped(bench)
    assert not state.grasped
    assert state.width < 1e-3


def test_grasp_beside_the_edge_does_not_hold(bench) -> None:
    edge = bench.edge
    bench.arm.connect()
    bench.arm.move_to(Pose(edge.x + 0.015, edge.z, edge.pitch))
    _arrive(bench)
    assert not _grasped(bench).grasped


def test_second_grasp_keeps_what_is_held(at_edge) -> None:
    held = _grasped(at_edge)
    again = _grasped(at_edge)
    assert again.grasped
    assert again.width == pytest.approx(held.width, abs=1e-4)


def test_opening_lets_go(at_edge) -> None:
    width = at_edge.hand.state().width
    _grasped(at_edge)
    at_edge.hand.open()
    state = until_still(at_edge)
    assert not state.grasped
    assert state.width == pytest.approx(width, abs=1e-3)


def test_stop_holds_the_fingers_where_they_are(at_edge) -> None:
    hand = at_edge.hand
    hand.grasp()
    at_edge.clock.wait_until(at_edge.clock.now() + 0.1)
    hand.stop()
    stopped = until_still(at_edge)
    assert not stopped.grasped
    at_edge.clock.wait_until(at_edge.clock.now() + 1.0)
    later = hand.state()
    assert later.width == pytest.approx(stopped.width, abs=1e-3)
    assert not later.grasped


def test_stop_keeps_hold_of_a_strip(at_edge) -> None:
    _grasped(at_edge)
    at_edge.hand.stop()
    assert until_still(at_edge).grasped
