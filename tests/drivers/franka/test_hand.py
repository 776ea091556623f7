"""The hand as users report it: not homed, missing thin things, deaf to stops; never
waited for.
"""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.base.clock import WallClock
from drivers.base.errors import Fault
from drivers.base.types import HandState
from drivers.franka.hand import FciHand, FingerState
from drivers.franka.hand_protocol import HEADER, HandCommand
from drivers.franka.settings import HandLimits
from drivers.twin.clock import TwinClock
from drivers.twin.fci_server.server import RobotServer

DENIM = HandLimits().for_thickness(0.0008, 0.001)
SLOW = DENIM.model_copy(update={"speed": 0.0001})  # minutes to close


@contextmanager
def driven(
    thickness: float | None, limits: HandLimits, **properties
) -> Iterator[tuple]:
    """A hand with something between its fingers, its driver, and what it is asked to
    do.
    """
    with RobotServer(between=lambda: server.thickness) as server:
        server.thickness, server.hand.width = thickness, 0.02
        for name, value in properties.items():
            setattr(server.hand, name, value)
        heard: list[HandCommand] = []
        begin = server.hand.begin
        server.hand.begin = lambda request: (
            heard.append(request.command),
            begin(request),
        )[1]
        hand = FciHand(server.address, limits, WallClock())
        try:
            yield server, hand, heard
        finally:
            hand.close()


def once(hand: FciHand, holds: Callable[[HandState], bool]) -> HandState:
    """The first state of the hand that satisfies `holds`."""
    clock = WallClock()
    while not holds(state := hand.state()):
        assert clock.now() < 30.0
        clock.wait_until(clock.now() + 0.005)
    return state


def rested(hand: FciHand) -> HandState:
    return once(hand, lambda state: not state.moving)


def empty(hand: FciHand) -> HandState:
    return once(hand, lambda state: not state.grasped)


def test_hand_that_is_not_homed_is_homed_before_it_opens() -> None:
    with driven(None, DENIM, is_homed=False) as (server, hand, heard):
        hand.open()
        state = rested(hand)
        assert heard == [HandCommand.HOMING, HandCommand.MOVE]
        assert server.hand.is_homed
        assert state.width == pytest.approx(DENIM.opening, abs=1e-3)
        hand.open()
        rested(hand)
        assert heard.count(HandCommand.HOMING) == 1


def test_hand_that_is_not_homed_grasps_nothing() -> None:
    with driven(0.0009, DENIM, is_homed=False) as (_, hand, heard):
        with pytest.raises(Fault, match="cell open") as fault:
            hand.grasp()
        assert fault.value.name == "hand_not_homed"
        assert not heard


@pytest.mark.parametrize("thickness", [0.0002, 0.0005, 0.001, 0.002])
@pytest.mark.parametrize("felt", [0.0, 0.003])
def test_fabric_is_held_by_its_width_whether_the_hand_says_so_or_not(
    thickness: float, felt: float
) -> None:
    limits = HandLimits().for_thickness(thickness, thickness)
    with driven(thickness, limits, felt=felt) as (server, hand, _):
        hand.grasp()
        assert not hand.state().grasped
        assert rested(hand).grasped
        assert server.hand.is_grasped is (felt == 0.0)


@pytest.mark.parametrize("thickness", [None, 0.00005, 0.01])
def test_what_is_no_strip_is_not_held(thickness: float | None) -> None:
    with driven(thickness, DENIM) as (_, hand, _):
        hand.grasp()
        assert not rested(hand).grasped


@pytest.mark.parametrize("start", [10, 0xFFFFFFFF])
def test_late_and_doubled_states_are_no_news(start: int) -> None:
    clock = TwinClock()
    hand = FciHand("127.0.0.1", DENIM, clock)
    held = FingerState(start, 0.0009, 0.08, grasped=True)
    empty = FingerState((start + 2) % 2**32, 0.0, 0.08, grasped=False)
    hand._fingers = FingerState(start - 1, 0.0, 0.08, grasped=False)
    for fingers in (held, empty):
        hand._store_state(fingers)
    clock.wait_until(0.1)
    for late in (held, empty, held):
        hand._store_state(late)
    assert hand._fingers == empty
    assert hand._stamp == 0.0  # it ages


@pytest.mark.parametrize("felt", [0.0, 0.003])
def test_strip_that_slips_out_is_seen(felt: float) -> None:
    with driven(0.0009, DENIM, felt=felt) as (server, hand, _):
        hand.grasp()
        assert rested(hand).grasped
        server.thickness = None
        if felt > 0:
            server.hand.width = 0.0  # what the fingers do once nothing is between them
        empty(hand)


def test_hand_that_itself_says_that_it_lost_its_grasp_holds_nothing() -> None:
    with driven(0.0009, DENIM) as (server, hand, _):
        hand.grasp()
        assert rested(hand).grasped
        server.hand.is_grasped = False  # with its fingers as far apart as before
        assert empty(hand).width == pytest.approx(0.0009)


def test_a_request_has_a_number_of_its_own_by_which_its_reply_is_known() -> None:
    with driven(None, DENIM) as (server, hand, _):
        answered, answer = [], server.hand._answer
        server.hand._answer = lambda request, status: (
            answered.append(request.command_id),
            answer(request, status),
        )
        for move in (hand.open, hand.grasp, hand.open):
            move()
            rested(hand)
        assert len({*answered}) == len(answered) == 3


def test_stop_that_is_not_heard_is_repeated() -> None:
    with driven(None, SLOW, deaf=1) as (server, hand, heard):
        hand.grasp()
        hand.stop()
        rested(hand)
        assert heard[:3] == [HandCommand.GRASP, HandCommand.STOP, HandCommand.STOP]
        assert server.hand.width > 0.0


def test_hand_that_hears_no_stop_is_a_fault() -> None:
    with driven(None, SLOW, deaf=99) as (_, hand, heard):
        hand.grasp()
        hand.stop()
        with pytest.raises(Fault, match="after 3 stops") as fault:
            rested(hand)
        assert fault.value.name == "hand_not_stopped"
        assert heard.count(HandCommand.STOP) == 3


def test_fingers_that_move_are_stopped_before_they_move_otherwise() -> None:
    with driven(None, HandLimits(opening=0.08)) as (_, hand, heard):
        hand.open()
        hand.grasp()
        rested(hand)
        assert [*dict.fromkeys(heard)] == [
            HandCommand.MOVE,
            HandCommand.STOP,
            HandCommand.GRASP,
        ]


def test_failure_of_the_hand_is_named() -> None:
    impossible = HandLimits.model_construct(**dict(HandLimits()) | {"opening": 0.2})
    with driven(None, impossible) as (_, hand, _):
        hand.open()
        with pytest.raises(Fault, match="could not do"):
            rested(hand)


def test_no_call_waits_for_the_fingers() -> None:
    with driven(None, SLOW, deaf=2) as (server, hand, _):
        hand.grasp()
        hand.state()
        hand.open()
        hand.stop()
        hand.state()
        assert server.hand.width > 0.019  # a call that waited would return at 0


def test_window_follows_the_calipers() -> None:
    window = HandLimits().for_thickness(0.0008, 0.001)
    assert (window.thinnest, window.thickest) == pytest.approx((0.0004, 0.003))
    assert HandLimits().for_thickness(0.0002, 0.0002).thinnest == pytest.approx(0.0001)
    assert HandLimits(thickest=0.002).for_thickness(
        0.001, 0.002
    ).thickest == pytest.approx(0.002)


def test_silent_hand_grows_old_though_it_last_said_that_it_holds() -> None:
    with driven(0.0009, DENIM) as (server, hand, _):
        hand.grasp()
        assert rested(hand).grasped
        server._hand_port.publish = server._hand_port.repeat = lambda *_: None
        clock = WallClock()
        clock.wait_until(clock.now() + 0.2)
        state = hand.state()
        assert state.grasped
        assert state.arrival - state.stamp > 0.1


@pytest.mark.parametrize("size", [0, 11, 65, 2**32 - 1])
def test_reply_of_a_size_that_none_has_is_a_lost_hand(size: int) -> None:
    with driven(None, DENIM) as (_, hand, _):
        hand.state()
        ours, theirs = socket.socketpair()
        ours.setblocking(False)
        with hand._links.tcp, ours, theirs:
            hand._links = hand._links._replace(tcp=ours)
            theirs.send(HEADER.pack(HandCommand.MOVE, 1, size) + bytes(2))
            with pytest.raises(Fault, match=f"a reply of {size} bytes") as fault:
                hand.state()
    assert fault.value.name == "hand_lost"


def test_connection_that_fails_leaves_no_socket_open() -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    hand = FciHand("127.0.0.77", DENIM, WallClock())
    with pytest.raises(Fault, match="does not answer") as fault:
        hand.state()
    assert fault.value.name == "hand_lost"
    assert len(list(Path("/proc/self/fd").iterdir())) == before
