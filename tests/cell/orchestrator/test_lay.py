"""The lay, driven tick by tick by an arm that does what it is told."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cell.base.config.settings import FoldSettings
from cell.base.devices.fold_path import (
    HUMP,
    LOOSE,
    LYING,
    PULL,
    edge_place,
    laid_height,
    lay_path,
    taut_edge,
)
from cell.orchestrator.context import FoldInputs, FoldLog
from cell.orchestrator.lay import BRAKING, LAY_TURNING, follow_lay
from cell.orchestrator.phases import FOLD_PHASES
from cell.orchestrator.snapshot import Drive, Hold, MoveTo, OpenHand
from cell.orchestrator.states import Event
from cell.perception.strip_measurement import SeenTouch
from drivers.base.types import Pose, Velocity
from policies.path import Path
from tests.support.plain_cell import GOOD, phases, plain_bench

TICK, REST, SPEED = 0.01, 0.0009, 0.1  # s, m, m/s
FOLD = FoldSettings()
HEIGHT, BEYOND = FOLD.lay_height, FOLD.lay_beyond


def driven(start: tuple[float, float]) -> list[Velocity]:
    """Velocities commanded from `start` to the fixed edge, up to the last move."""
    begin = replace(GOOD, arm=replace(GOOD.arm, pose=Pose(*start, math.pi / 2)))
    lay = follow_lay(Path.through(np.array([start, (0.0, REST)])), SPEED, begin)
    command, snapshot, told = next(lay), begin, []
    while isinstance(command, Drive):
        told.append(command.velocity)
        pose, rate = snapshot.arm.pose, command.velocity
        x, z = pose.x + TICK * rate.vx, pose.z + TICK * rate.vz
        pitch = pose.pitch + TICK * rate.pitch_rate
        snapshot = replace(snapshot, arm=replace(snapshot.arm, pose=Pose(x, z, pitch)))
        command = lay.send(snapshot)
    return told[1:]  # the first one is that of the fold


@pytest.mark.parametrize("start", [(0.2, 0.24), (0.038, 0.038)], ids=["long", "short"])
def test_lay_ends_slowly_and_turns_no_faster_than_an_arm_may(
    start: tuple[float, float],
) -> None:
    told = driven(start)
    speeds = [math.hypot(v.vx, v.vz) for v in told]
    assert max(speeds) <= SPEED + 1e-9
    # m, in which it could stop after one more tick
    assert speeds[-1] ** 2 / (2 * BRAKING) < 1e-3 + TICK * speeds[-1]
    assert max(abs(v.pitch_rate) for v in told) <= LAY_TURNING
    assert all(v.vz < 0.0 for v in told)
    turned = math.pi / 2 + TICK * sum(v.pitch_rate for v in told)
    assert turned == pytest.approx(LYING, abs=0.1)


def touched(displacement: float) -> SeenTouch:
    return SeenTouch(
        5.0, 0.25, 0.25 + displacement, 0.25, confidence=1.0, distance=0.001
    )


@pytest.mark.parametrize(
    ("displacement", "end", "down"),
    [
        (0.0, 0.0, -BEYOND),
        (-0.003, 0.0, 0.003 - BEYOND),
        (0.004, 0.0, -0.004 - BEYOND),
        (-0.03, 0.03 - PULL, 0.03 - BEYOND),
    ],
)
def test_grasped_edge_is_pushed_to_a_hump_before_the_fixed_one_unless_that_pulls_far(
    displacement: float, end: float, down: float
) -> None:
    taut = taut_edge(touched(displacement))
    assert edge_place(taut) == pytest.approx(end)
    path = lay_path(Pose(0.2, 0.22, np.pi / 2), taut, REST, end, FOLD)
    last = np.array([(end + HUMP, REST + HEIGHT), (down + HUMP, REST)])
    assert path.points[-2:] == pytest.approx(last)


def test_edge_is_laid_over_the_lower_layer_and_let_go_before_the_hand_leaves() -> None:
    """The fingers open a little, and go on backwards, before the hand rises."""

    def touch(_given: FoldInputs, log: FoldLog, *_):
        yield Hold()
        log.seen_touch = replace(touched(0.0), distance=0.003)
        return Event.LAYER_TOUCH

    bench = replace(plain_bench(), phases=FOLD_PHASES | phases(FOLD=touch))
    bench.hand.commands = commands = bench.arm.commands
    assert bench.run().name == "edges_not_seen"
    rest, far = laid_height(0.003), FOLD.approach
    x, z = HUMP + far * math.cos(LYING), rest + far * math.sin(LYING)
    *_, laid, opened, back, up = [
        c for c in commands if isinstance(c, MoveTo | OpenHand)
    ]
    assert opened.width == pytest.approx(LOOSE, abs=0.002)
    assert laid.pose.as_array() == pytest.approx([HUMP, rest, LYING])
    assert back.pose.as_array() == pytest.approx([x, z, LYING], abs=1e-6)
    assert up.pose.as_array() == pytest.approx([x, z + 2 * far, LYING], abs=1e-6)
