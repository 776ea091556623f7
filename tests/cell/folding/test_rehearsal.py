"""The fold in the air: raised, on its path, with fingers that hold nothing, nothing on
the desk.
"""

import json
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

from cell.base.config.places import CHECKOUT_CONFIGS
from cell.base.devices.devices import Devices, Trial
from cell.base.devices.fold_path import triangle, whole_path
from cell.base.devices.open import open_cell
from cell.folding.rehearsal import HOVER_HEIGHT, Rehearsal, rehearsal
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.steps import pause
from cell.setup.arm import manual_motion
from drivers.base.geometry import interpolate_columns
from tests.support.commands import invoke
from tests.support.fold_moments import lying, scene_for
from tests.support.maker_scene import Moment
from tests.support.refusals import refusal
from tests.support.requests import CELL, DENIM

FCI = CELL.model_copy(update={"installation": CELL.fci.limit(CELL.installation)})
RUNBOOKS = CHECKOUT_CONFIGS.parent / "runbooks"
CLOSED = 0.001  # m between pads that do not touch one another
PATH, SPEEDS = whole_path(0.6, FCI.installation, FCI.fold, triangle(0.6))


@pytest.fixture(scope="module")
def elbow() -> float:
    """The elbow [rad] over the strip, which takes a search."""
    return float(manual_motion.home_joints(CELL, DENIM)[2])


def test_fold_that_does_not_fit_in_the_air_is_refused() -> None:
    higher = np.add(PATH, (0.0, 0.05, 0.0))
    with refusal(r"reaches z 0\.55 m, the workspace ends at 0\.50"):
        rehearsal(FCI, DENIM, higher, SPEEDS)


def test_arm_that_cannot_follow_in_the_air_is_refused(elbow) -> None:
    away = np.add(PATH, (0.25, 0.0, 0.0))
    rehearsal(FCI, DENIM, away, SPEEDS)  # by an arm that has no joints
    with refusal("cannot follow the fold in the air"):
        rehearsal(FCI, DENIM, away, SPEEDS, elbow)


@pytest.fixture(scope="module")
def carried(request: pytest.FixtureRequest, elbow: float) -> SimpleNamespace:
    """The rehearsal by an arm of the kind asked for: its `planned` path, outcome, the
    snapshots `seen`, and a robot's `joints` tick by tick.
    """
    planned = rehearsal(FCI, DENIM, PATH, SPEEDS, elbow)
    seen: list[Snapshot] = []
    opened: list[Devices] = []

    def watched(snapshot):
        motion = planned.motion(snapshot)
        command = next(motion)
        while True:
            seen.append((yield command))
            try:
                command = motion.send(seen[-1])
            except StopIteration as end:
                return end.value

    def keeping(*arguments, **options) -> Devices:
        opened.append(open_cell(*arguments, **options))
        return opened[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(manual_motion, "open_cell", keeping)
        settings = FCI.with_drivers(request.param)
        outcome = manual_motion.move_manually(settings, Trial(), watched, strip=DENIM)
    assert outcome.exit_code == 0, outcome.reason
    return SimpleNamespace(planned=planned, seen=seen, joints=opened[0].arm_joints())


@pytest.mark.slow
@pytest.mark.parametrize("carried", ["twin", "fci"], indirect=True)
def test_rehearsal_stays_on_its_raised_path_and_closes_and_opens_the_hand(
    carried: SimpleNamespace,
) -> None:
    path = carried.planned.path
    places = np.array([(now.arm.pose.x, now.arm.pose.z) for now in carried.seen])
    begun = int(np.argmax(places[:, 1] > path[0, 1] - 0.002))
    line = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(path[:, :2])])
    off = [np.hypot(*(line - place).T).min() for place in places[begun:]]
    assert max(off) < 0.005
    assert places[begun:, 1].min() > HOVER_HEIGHT - 0.005
    assert places[-1, 0] == pytest.approx(path[-1, 0], abs=0.003)
    widths = [now.hand.width for now in carried.seen]
    assert min(widths) < 0.001  # closed on nothing, and that is no fault
    assert widths[-1] > 0.03


@pytest.mark.slow
@pytest.mark.parametrize("carried", ["fci"], indirect=True)
def test_rehearsed_joints_keep_the_maker_s_hand_on_its_way_and_off_all_else(
    carried: SimpleNamespace,
) -> None:
    scene, flat = scene_for(FCI.installation, DENIM), lying(DENIM)
    times, joints = carried.joints[:, 0], carried.joints[:, 1:8]
    moments = [
        Moment(
            now.arm.pose.as_array(),
            interpolate_columns(now.arm.stamp, times, joints),
            max(now.hand.width, CLOSED),
            flat,
            held=True,
        )
        for now in carried.seen
    ]
    assert scene.judge(moments) == (len(moments), [])


def test_command_reports_the_rehearsal_of_the_first_day(
    monkeypatch, tmp_path, configs
) -> None:
    monkeypatch.setattr(Rehearsal, "motion", lambda _, snapshot: _still(snapshot))
    page = (RUNBOOKS / "first-day-with-a-real-arm.md").read_text("utf-8")
    # with which the page's own command fits
    height = page.partition("`z: ")[2].partition("`")[0]
    file = configs / "cell.yaml"
    file.write_text(file.read_text().replace("z: [-0.01, 0.50]", f"z: {height}"))
    words = "fold --strip denim --policy planned --rehearse --json"
    done = invoke(words, f"--runs {tmp_path}/runs --configs {configs}")
    assert json.loads(done.stdout)["exit_code"] == done.exit_code == 0
    assert not (tmp_path / "runs").exists()  # a rehearsal leaves no run


def _still(snapshot):
    return (yield from pause(0.05))
