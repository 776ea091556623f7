"""Commands that phases give."""

import numpy as np
import pytest

from cell.orchestrator.steps import TURNING, drive
from drivers.installation import Installation
from policies.policy import Decision


@pytest.mark.parametrize("asked", [-9.0, -2.0, 0.0, 1.6, 2.7, 9.0])
def test_no_correction_of_the_pitch_asks_for_more_than_an_arm_gives(asked: float) -> None:
    decision = Decision(
        direction=np.array([0.5]),
        speed=np.array([0.1]),
        pitch_rate=np.array([0.0]),
        done=np.array([False]),
    )
    rate = drive(decision, asked).velocity.pitch_rate
    assert abs(rate) <= TURNING < Installation().limits.pitch.velocity
    assert rate == asked or abs(asked) > TURNING
