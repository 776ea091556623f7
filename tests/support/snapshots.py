"""A moment of a fold at which nothing is wrong."""

import math
from dataclasses import replace

import numpy as np

from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.states import State
from cell.orchestrator.vision import View
from cell.perception.measurement import StripMeasurement
from drivers.types import ZERO_VELOCITY, ArmState, Frame, HandState, Pose

POSE = Pose(0.4, 0.2, math.pi / 2)
ARM = ArmState(10.0, 10.0, "test", POSE, ZERO_VELOCITY, POSE, moving=True, expired=False)
HAND = HandState(10.0, 10.0, "test", width=0.001, grasped=True, moving=False)
FRAME = Frame(9.97, 9.99, "test", 7, np.zeros((2, 2, 3), np.uint8))
SIGHT = StripMeasurement(9.97, 7, 0.3, 1.0, np.zeros((3, 2)), 1.0, (0.5, 0.02), math.nan, math.nan)
GOOD = Snapshot(
    time=10.0,
    state=State.FOLD,
    entered=5.0,
    arm=ARM,
    hand=HAND,
    view=View(frame=FRAME, fresh=True, measurement=SIGHT),
)


def showing(**changes) -> Snapshot:
    return replace(GOOD, view=replace(GOOD.view, **changes))
