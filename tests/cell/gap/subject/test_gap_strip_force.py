"""Force on the gripper as a channel: it separates what images alone cannot."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from cell.gap.subject.strip.subject import StripSubject
from tests.support.gap_strip_cases import (
    FEELING,
    folds,
    in_noise,
    opened,
    residuals,
    whitened,
    written,
)

LATE = np.array([0.012])  # s


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> StripSubject:
    """Folds of an arm that reports its places late, and the force of the strip."""
    root = tmp_path_factory.mktemp("late") / "runs"
    written(
        root,
        folds(["fast", "early-shake"], {"control_delay": {"time": LATE[0]}}),
        FEELING,
    )
    return opened(root)


def test_force_separates_a_late_arm_from_a_late_camera(late: StripSubject) -> None:
    arm = residuals(late, {"control_delay": LATE})
    camera = residuals(late, {"camera_latency": -LATE})
    for channel in ("profile", "contact_x"):
        assert in_noise(late, camera, channel) == pytest.approx(
            in_noise(late, arm, channel), rel=0.1
        )
    left = [whitened(late, found)[force_rows(late)] for found in (arm, camera)]
    assert np.mean(left[0] ** 2) < 1.5
    assert np.sum(left[1] ** 2) - np.sum(left[0] ** 2) > 40.0


def test_where_force_is_measured_it_weighs_the_strip(late: StripSubject) -> None:
    assert late.scope.base[-1].name == "areal_density"
    stated = [late.stated(run) for run in late.runs]
    heavier = [replace(q, base=q.base * [1.0, 1.0, 1.1]) for q in stated]
    found = [late.simulate(asked) for asked in (stated, heavier)]
    here, there = (np.concatenate([r.mean for r in part]) for part in found)
    apart, rows = np.abs(there - here), force_rows(late)
    assert apart[rows].max() > 0.001
    assert np.nanmax(apart[~rows]) < 1e-4


def force_rows(strip: StripSubject) -> NDArray[np.bool_]:
    return np.concatenate([run.samples.channel == "force" for run in strip.runs])
