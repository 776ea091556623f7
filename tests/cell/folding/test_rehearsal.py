"""The fold in the air: raised, on its path, with fingers that hold nothing, nothing on
the desk.
"""

import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from cell.base.config.places import CHECKOUT_CONFIGS, find_configs
from cell.base.devices.devices import Trial
from cell.base.devices.fold_path import LOOSE, triangle, whole_path
from cell.folding.rehearsal import HOVER_HEIGHT, Rehearsal, rehearsal
from cell.interface.cli.app import app
from cell.orchestrator.steps import pause
from cell.setup.arm.manual_motion import home_joints, move_manually
from drivers.base.errors import ConfigurationError
from drivers.base.types import Pose

CONFIGS = find_configs(None)
SETTINGS = CONFIGS.cell()
FCI = SETTINGS.model_copy(
    update={"installation": SETTINGS.fci.limit(SETTINGS.installation)}
)
STRIP = CONFIGS.strip("denim")
PATH, SPEEDS = whole_path(0.6, FCI.installation, FCI.fold, triangle(0.6))


@pytest.fixture(scope="module")
def elbow() -> float:
    """The elbow [rad] over the strip, which takes a search."""
    return float(home_joints(SETTINGS, STRIP)[2])


def test_fold_that_does_not_fit_in_the_air_is_refused() -> None:
    higher = np.add(PATH, (0.0, 0.05, 0.0))
    with pytest.raises(
        ConfigurationError, match=r"reaches z 0\.55 m, the workspace ends at 0\.50"
    ):
        rehearsal(FCI, STRIP, higher, SPEEDS)


def test_arm_that_cannot_follow_in_the_air_is_refused(elbow) -> None:
    away = np.add(PATH, (0.25, 0.0, 0.0))
    rehearsal(FCI, STRIP, away, SPEEDS)  # by an arm that has no joints
    with pytest.raises(ConfigurationError, match="cannot follow the fold in the air"):
        rehearsal(FCI, STRIP, away, SPEEDS, elbow)


@pytest.mark.parametrize(
    "arm",
    [
        pytest.param("twin", marks=pytest.mark.slow),
        pytest.param("fci", marks=pytest.mark.long),
    ],
)
def test_rehearsal_stays_on_its_raised_path_and_closes_and_opens_the_hand(
    arm: str, elbow: float
) -> None:
    planned = rehearsal(FCI, STRIP, PATH, SPEEDS, elbow)
    seen: list[tuple[Pose, float]] = []

    def watched(snapshot):
        motion = planned.motion(snapshot)
        command = next(motion)
        while True:
            snapshot = yield command
            seen.append((snapshot.arm.pose, snapshot.hand.width))
            try:
                command = motion.send(snapshot)
            except StopIteration as end:
                return end.value

    outcome = move_manually(FCI.with_drivers(arm), Trial(), watched, strip=STRIP)
    assert outcome.exit_code == 0, outcome.reason
    places = np.array([(pose.x, pose.z) for pose, _ in seen])
    line = np.concatenate(
        [
            np.linspace(a, b, 200)
            for a, b in zip(planned.path[:-1], planned.path[1:], strict=True)
        ]
    )[:, :2]
    begun = next(
        n for n, (pose, _) in enumerate(seen) if pose.z > planned.path[0, 1] - 0.002
    )
    off = [np.hypot(*(line - place).T).min() for place in places[begun:]]
    assert max(off) < 0.005
    assert places[begun:, 1].min() > HOVER_HEIGHT - 0.005
    assert seen[-1][0].x == pytest.approx(planned.path[-1, 0], abs=0.003)
    widths = np.array([width for _, width in seen])
    assert widths.min() < 0.001  # closed on nothing, and that is no fault
    assert widths[-1] > LOOSE - 1e-4


def test_command_reports_the_rehearsal_of_the_first_day(
    monkeypatch, tmp_path, capsys
) -> None:
    monkeypatch.setattr(Rehearsal, "motion", lambda _, snapshot: _still(snapshot))
    page = (
        CHECKOUT_CONFIGS.parent / "runbooks/first-day-with-a-real-arm.md"
    ).read_text("utf-8")
    # with which the page's own command fits
    height = page.partition("`z: ")[2].partition("`")[0]
    content = (
        shutil.copytree(CHECKOUT_CONFIGS, tmp_path / "c") / "cell.yaml"
    ).read_text("utf-8")
    (tmp_path / "c/cell.yaml").write_text(
        content.replace("z: [-0.01, 0.50]", f"z: {height}")
    )
    words = ["fold", "--strip", "denim", "--policy", "planned", "--rehearse", "--json"]
    places = ["--runs", str(tmp_path / "runs"), "--configs", str(tmp_path / "c")]
    done = CliRunner().invoke(app, [*words, *places])
    assert json.loads(done.stdout)["exit_code"] == done.exit_code == 0
    assert not (tmp_path / "runs").exists()  # a rehearsal leaves no run


def _still(snapshot):
    return (yield from pause(0.05))
