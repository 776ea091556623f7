"""The lay, driven tick by tick by an arm that does what it is told."""

from dataclasses import replace
from math import hypot, nan

import numpy as np
import pytest

from cell.base.config.settings import FoldSettings
from cell.base.devices.fold_path import (
    HANGING,
    LOOSE,
    PULL,
    LayPlan,
    lay_plan,
    taut_edge,
)
from cell.orchestrator import phases as fold_phases
from cell.orchestrator.context import FoldInputs, FoldLog
from cell.orchestrator.phases import ALIGNED, BRAKING, FOLD_PHASES, follow_lay
from cell.orchestrator.snapshot import Drive, Hold, MoveTo, OpenHand
from cell.orchestrator.states import Trigger
from cell.perception.strip_measurement import SeenTouch
from drivers.base.types import Pose, Velocity
from drivers.franka.shapes import ROOM, TIP_AHEAD
from policies.path import Path
from tests.support.plain_cell import of_arm, phases, plain_bench

TICK, LAG, REST, SPEED = 0.01, 0.1, 0.0079, 0.1  # s, s, m, m/s
FOLD = FoldSettings()


def driven(start: tuple[float, float]) -> tuple[list[Velocity], Pose]:
    """Velocities commanded from `start` to the fixed edge, up to the last move, of an
    arm that trails by LAG, and where it was commanded last.
    """
    at = Pose(*start, HANGING)
    plan = LayPlan(Path.through(np.array([start, (0.0, REST)])), 0.0)
    lay = follow_lay(plan, SPEED, of_arm(pose=at, commanded=at))
    command, told, commanded, measured = next(lay), [], *2 * [at.as_array()]
    while isinstance(command, Drive):
        told.append(command.velocity)
        commanded = commanded + TICK * np.array([*command.velocity])
        measured = measured + TICK / LAG * (commanded - measured)
        shown = of_arm(pose=Pose(*measured), commanded=Pose(*commanded))
        command = lay.send(shown)
    return told[1:], shown.arm.commanded  # the first one is that of the fold


@pytest.mark.parametrize("start", [(0.2, 0.24), (0.038, 0.038)], ids=["long", "short"])
def test_lay_ends_slowly_at_its_end_with_the_hand_upright(
    start: tuple[float, float],
) -> None:
    told, end = driven(start)
    speeds = [hypot(v.vx, v.vz) for v in told]
    assert max(speeds) <= SPEED + 1e-9
    # m, in which it could stop after one more tick
    assert speeds[-1] ** 2 / (2 * BRAKING) < 1e-3 + TICK * speeds[-1]
    assert {v.pitch_rate for v in told} == {0.0}
    assert all(v.vz < 0.0 for v in told)
    assert end.z == pytest.approx(REST, abs=1e-3)


def touched(displacement: float) -> SeenTouch:
    return SeenTouch(
        5.0, 0.25, 0.25 + displacement, 0.25, confidence=1.0, distance=0.001
    )


@pytest.mark.parametrize(
    ("displacement", "place", "end", "down"),
    [
        (0.0, 0.0, 0.0, 0.0),
        (0.004, 0.0, 0.0, -0.004),
        (-0.2, 0.2, 0.2, 0.2),  # of a fold off the middle
        (-0.03, 0.0, 0.03 - PULL, 0.03 - PULL),
    ],
)
def test_edge_comes_down_at_its_place_or_where_its_layer_ends_unless_that_pulls_far(
    displacement: float, place: float, end: float, down: float
) -> None:
    taut = taut_edge(touched(displacement))
    plan = lay_plan(Pose(0.2, 0.22, HANGING), taut, 0.001, place, FOLD)
    assert plan.end == pytest.approx(end)
    rest = 0.001 + ROOM + TIP_AHEAD
    x = down + rest - FOLD.lay_beyond
    above, last = plan.path.points[-2:]
    assert last == pytest.approx([x, rest])
    assert above == pytest.approx([x, rest + FOLD.lay_height])


def lay_of(
    monkeypatch: pytest.MonkeyPatch, seen: list[float]
) -> tuple[list[object], FoldLog]:
    """Commands and log of a lay whose camera sees the edge beyond its place by `seen`
    [m].
    """
    logs = []

    def touch(_given: FoldInputs, log: FoldLog, *_):
        yield Hold()
        log.seen_touch = replace(touched(0.0), distance=0.003)
        logs.append(log)
        return Trigger.LAYER_TOUCH

    def look(*_):
        yield Hold()
        return seen.pop(0)

    monkeypatch.setattr(fold_phases, "_seen_beyond", look)
    bench = replace(plain_bench(), phases=FOLD_PHASES | phases(FOLD=touch))
    bench.hand.commands = commands = bench.arm.commands
    assert bench.run().name == "edges_not_seen"
    return [c for c in commands if isinstance(c, MoveTo | OpenHand)], logs[0]


HIGH = 0.00345 + ROOM + TIP_AHEAD  # m, over layers 3 mm apart
DOWN = Pose(HIGH - FOLD.lay_beyond, HIGH, HANGING)


def test_edge_is_let_go_before_the_hand_leaves_straight_up(monkeypatch) -> None:
    *_, laid, opened, up = lay_of(monkeypatch, [ALIGNED])[0]
    assert opened.width == pytest.approx(LOOSE, abs=0.002)
    assert laid.pose.as_array() == pytest.approx(DOWN.as_array())
    assert up.pose.as_array() == pytest.approx([DOWN.x, DOWN.z + 0.15, HANGING])


@pytest.mark.parametrize(
    ("seen", "pushed", "bent"),
    [
        ([0.004, 0.0002], [0.004], 0.0002),
        ([0.004, 0.004, 0.003, 0.0], [0.004, -0.002, 0.001], -0.003),  # it bows up
        (
            [0.004, 0.003, 0.006, 0.004],
            [0.004, -0.001, 0.005],
            0.0,
        ),  # the fold is drawn
        ([0.004, nan], [0.004], 0.0),
    ],
)
def test_edge_is_pushed_until_the_camera_sees_it_at_its_place(
    seen: list[float], pushed: list[float], bent: float, monkeypatch
) -> None:
    (*moves, _, _), log = lay_of(monkeypatch, seen)
    places = dict.fromkeys(c.pose.x - DOWN.x for c in moves if c.pose.z == DOWN.z)
    assert list(places) == pytest.approx([0.0, *pushed])
    assert log.bent == pytest.approx(bent)
