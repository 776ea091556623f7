"""Whatever goes wrong in a run, the arm is brought to rest before the run is over."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from math import inf, nan, pi
from types import SimpleNamespace

import pytest

import cell.orchestrator.run as orchestrator
from cell.orchestrator.snapshot import (
    CloseHand,
    Drive,
    Hold,
    MoveTo,
    OpenHand,
    Snapshot,
)
from cell.orchestrator.states import State, Trigger
from cell.orchestrator.steps import close_hand, move, open_hand, wait_for
from drivers.base.errors import Fault
from drivers.base.types import ArmState, Frame, Pose, Velocity
from tests.support.plain_cell import AWAY, Bench, driven, ending, phases, plain_bench

BEGIN = 0.5  # s, from when on things go wrong


@pytest.fixture
def bench() -> Bench:
    return plain_bench()


def later(
    bench: Bench, act: Callable, *, until=inf, error=ZeroDivisionError
) -> Callable:
    """`act`, but between BEGIN and `until` it fails in a way that nobody foresaw."""

    def failing(*arguments, **options):
        if BEGIN < bench.now < until:
            raise error("nobody foresaw this")
        return act(*arguments, **options)

    return failing


def break_parts(bench: Bench, parts: Mapping[str, float]) -> None:
    """Break each of the `parts`, as camera.read, for so long [s]."""
    for part, lasting in parts.items():
        device, _, method = part.partition(".")
        owner = getattr(bench, device)
        setattr(
            owner, method, later(bench, getattr(owner, method), until=BEGIN + lasting)
        )


def break_camera(bench: Bench) -> None:
    break_parts(bench, {"camera.read": inf})


def break_clock_for_a_while(bench: Bench) -> None:
    wait_until = bench.clock.wait_until

    def limping(time: float) -> None:
        wait_until(time)
        if BEGIN < bench.now < BEGIN + 0.2:
            raise ZeroDivisionError("nobody foresaw this")

    bench.clock.wait_until = limping


@pytest.mark.parametrize(
    "breaks",
    [
        break_camera,
        partial(break_parts, parts={"hand.state": inf, "hand.stop": inf}),
        partial(break_parts, parts={"record.tick": inf}),
        partial(
            break_parts,
            parts={f"record.{p}": inf for p in ("tick", "event", "frame")},
        ),
        partial(break_parts, parts={"camera.read": inf, "arm.stop": 0.2}),
        partial(break_parts, parts={"arm.state": 0.3}),
        break_clock_for_a_while,
    ],
)
def test_the_arm_rests_before_the_run_is_over_whatever_fails(bench, breaks) -> None:
    record = bench.record
    bench.record = SimpleNamespace(
        **{n: getattr(record, n) for n in dir(record) if n[0] != "_"}
    )
    breaks(bench)
    outcome = bench.run()
    assert outcome.name == "internal_error"
    assert "nobody foresaw this" in outcome.reason
    assert outcome.exit_code == 4
    assert bench.at_rest
    assert bench.now < BEGIN + 1.1


def test_an_arm_that_creeps_where_it_was_commanded_does_not_rest_yet(bench) -> None:
    break_camera(bench)
    state, settled = bench.arm.state, BEGIN + 0.6

    def creeping() -> ArmState:
        now = state()
        still = now.moving or bench.now >= settled
        return now if still else replace(now, velocity=Velocity(0.002, 0.0, 0.0))

    bench.arm.state = creeping
    assert bench.run().name == "internal_error"
    assert settled <= bench.now < settled + 0.1


def test_an_arm_that_never_answers_again_is_stopped_repeatedly_until_its_time_is_over(
    bench,
) -> None:
    break_parts(bench, {"arm.state": inf})
    outcome = bench.run()
    assert outcome.exit_code == 4
    stops = [command for command in bench.arm.commands if isinstance(command, Hold)]
    assert len(stops) > 90
    assert bench.now == pytest.approx(BEGIN + 1.0, abs=0.05)


def test_a_resting_arm_that_no_stop_has_reached_is_stopped_again(bench) -> None:
    bench.phases = phases(FOLD=lambda *_: wait_for(lambda _: False))
    break_parts(bench, {"camera.read": inf, "arm.stop": 0.3})
    assert bench.run().exit_code == 4
    assert BEGIN + 0.3 <= bench.now < BEGIN + 0.4


def test_a_first_look_that_fails_is_an_outcome_and_no_error(bench) -> None:
    def dead() -> ArmState:
        raise Fault("arm_closed", "nobody is there")

    bench.arm.state = dead
    assert bench.run().name == "arm_closed"


@pytest.mark.parametrize("velocity", [nan, inf, 3.0])
def test_a_velocity_that_no_arm_may_follow_stops_the_arm(bench, velocity) -> None:
    def runaway(*_):
        yield from driven(30)()
        while True:
            yield Drive(Velocity(velocity, 0.0, 0.0))

    bench.phases = phases(FOLD=runaway)
    assert bench.run().name == "command_refused"
    assert bench.at_rest
    drives = [c for c in bench.arm.commands if isinstance(c, Drive)]
    assert {command.velocity for command in drives} == {AWAY}


def test_a_path_that_ends_in_motion_ends_at_rest(bench) -> None:
    bench.phases = phases(FOLD=driven(50))
    outcome = bench.run()
    assert (outcome.name, outcome.exit_code) == ("path_done", 1)
    assert bench.at_rest


def test_what_was_sent_before_a_velocity_is_sent_again_after_it(bench) -> None:
    goal, drive, sent = MoveTo(Pose(0.5, 0.2, 1.5)), Drive(AWAY), bench.arm.commands
    order = [goal, drive, goal, Hold(), drive, Hold()]

    def changing(*_):
        for command in order:
            yield command
            yield command
        return Trigger.PATH_DONE

    bench.phases = phases(FOLD=changing)
    assert bench.run().name == "path_done"
    in_turn = [one for one, _ in itertools.groupby(sent[sent.index(goal) :])]
    assert in_turn == order


def test_interrupting_stops_within_the_limits_of_the_motion(bench) -> None:
    bench.interrupted = lambda: bench.now > BEGIN
    outcome = bench.run()
    assert (outcome.name, outcome.exit_code) == ("interrupted", 130)
    assert bench.at_rest
    assert bench.now - BEGIN < 0.15


def test_an_observer_that_fails_holds_nothing_up(bench) -> None:
    def broken(*news) -> None:
        raise ZeroDivisionError

    seen: list[Snapshot] = []
    good = SimpleNamespace(handle_tick=seen.append, handle_event=lambda *news: None)
    bad = SimpleNamespace(handle_tick=broken, handle_event=broken)
    bench.observers = (bad, good)
    bench.phases = phases(FOLD=ending(Trigger.PATH_DONE))
    assert bench.run().name == "path_done"
    assert len(seen) >= 4


def test_moving_fingers_are_stopped_and_resting_ones_keep_their_hold(bench) -> None:
    break_camera(bench)
    bench.run()
    assert bench.hand.stopped == 0
    again = plain_bench()
    break_camera(again)
    again.hand.moving = True
    again.run()
    assert again.hand.stopped == 1


def test_fingers_are_stopped_where_no_state_follows_their_command(bench) -> None:
    bench.hand.open = lambda _: setattr(bench.hand, "state", None)
    bench.phases = phases(GRASP=lambda *_: open_hand())
    assert bench.run().name == "internal_error"
    assert bench.hand.stopped == 1


def test_ctrl_c_that_ends_a_run_at_once_stops_moving_fingers_too(bench) -> None:
    bench.hand.moving = True
    bench.interrupted = later(bench, bench.interrupted, error=KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        bench.run()
    assert (bench.hand.stopped, bench.arm.commands[-1]) == (1, Hold())


def test_every_command_is_checked_before_it_is_sent(bench, monkeypatch) -> None:
    """Also the first of a state, and those to the hand."""
    checked: list[tuple[State, object]] = []
    check_all = orchestrator.check_all

    def checking(snapshot, command, rules) -> None:
        assert snapshot.entered <= snapshot.time
        checked.append((snapshot.state, command))
        check_all(snapshot, command, rules)

    def grasping(*_):
        yield from open_hand()
        yield from move(Pose(0.55, 0.1, pi / 2))
        yield from close_hand()
        return Trigger.GRASPED

    monkeypatch.setattr(orchestrator, "check_all", checking)
    bench.phases = phases(GRASP=grasping, FOLD=driven(5))
    sent: list[object] = []
    for device, names in (
        (bench.arm, ("move_to", "set_velocity")),
        (bench.hand, ("open", "grasp")),
    ):
        for name in names:
            monkeypatch.setattr(
                device, name, sending(getattr(device, name), checked, sent)
            )
    assert bench.run().name == "path_done"
    assert sent == ["open", "move_to", "grasp", *5 * ["set_velocity"]]
    first = dict(reversed(checked))
    assert first[State.GRASP] == OpenHand()
    assert first[State.FOLD] == Drive(AWAY)


def sending(act: Callable, checked: list, sent: list) -> Callable:
    kinds = {
        "move_to": MoveTo,
        "set_velocity": Drive,
        "open": OpenHand,
        "grasp": CloseHand,
    }

    def send(*arguments) -> None:
        assert isinstance(checked[-1][1], kinds[act.__name__])
        sent.append(act.__name__)
        act(*arguments)

    return send


def test_a_fault_is_never_resumed(bench) -> None:
    """The camera fails once and is well again: the run has ended all the same."""
    bench.camera.read = later(bench, bench.camera.read, until=BEGIN + 0.02)
    states: list[str] = []
    seen: list[Snapshot] = []
    bench.observers = (
        SimpleNamespace(
            handle_tick=seen.append,
            handle_event=lambda time, kind, facts: states.append(
                str(facts.get("state", kind))
            ),
        ),
    )
    bench.run()
    assert states[-3:] == ["fault", "STOPPING", "FAULT"]
    braking = [shown.view for shown in seen if shown.state is State.STOPPING]
    assert braking
    assert not any(view.fresh or view.read for view in braking)  # no image counts twice
    drives = [i for i, c in enumerate(bench.arm.commands) if isinstance(c, Drive)]
    assert all(isinstance(c, Hold) for c in bench.arm.commands[drives[-1] + 1 :])


def test_images_and_arm_states_of_the_future_are_refused(bench) -> None:
    read = bench.camera.read

    def ahead(after: float, timeout: float) -> Frame | None:
        frame = read(after, timeout)
        late = bench.now > BEGIN and frame is not None
        return replace(frame, stamp=frame.stamp + 30.0) if late else frame

    bench.camera.read = ahead
    assert bench.run().name == "image_stale"
    assert bench.at_rest


def test_a_loop_that_is_late_still_brakes_in_whole_cycles(bench) -> None:
    """A clock that jumps ahead, as after a stall, does not use up the time to brake."""
    inner, late = bench.clock, [0.0]

    class Late:
        def now(self) -> float:
            return inner.now() + late[0]

        def wait_until(self, time: float) -> None:
            inner.wait_until(time - late[0])

    def stalls(*_):
        yield from driven(50)()
        late[0] = 30.0
        raise Fault("stalled", "nobody foresaw this")

    bench.phases = phases(FOLD=stalls)
    arm = bench.arm
    bench.clock = Late()
    assert bench.run().name == "stalled"
    assert bench.at_rest
    assert arm.commands[-1] == Hold()
