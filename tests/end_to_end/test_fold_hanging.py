"""A robot's fold is measured from the strip that hangs, and every reader of runs takes
it so.
"""

from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from cell.base.config.places import find_configs
from cell.folding.replay import replay
from cell.folding.request import RecordingOptions
from cell.record.files import RUN
from cell.report.page import write_report
from cell.report.viz.recording import viz_from_run
from drivers.franka.limits import FR3
from tests.end_to_end.folded import Folded, fold_and_keep
from tests.support.fold_moments import carried_out, scene_for
from tests.support.gap_strip_cases import folds, in_noise, opened, residuals, written
from tests.support.requests import request_for

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        find_spec("pylibfranka") is None, reason="pylibfranka is not installed"
    ),
]


@pytest.fixture(scope="module")
def fold(tmp_path_factory: pytest.TempPathFactory) -> Folded:
    """A fold of denim through the robot's library, in lock-step."""
    runs, robot = (
        tmp_path_factory.mktemp("hanging"),
        find_configs(None).cell().with_drivers("fci"),
    )
    kept = RecordingOptions(
        frames="all"
    )  # replay decides from the images that lie there
    asked = request_for("denim", "feedback", runs, cell=robot, record=kept)
    return fold_and_keep(asked)


def test_measured_time_begins_with_a_strip_that_hangs_still(fold: Folded) -> None:
    ticks = fold.run.ticks
    assert fold.run.header.start == "hanging"
    assert 0.0 <= ticks.t[0] < 0.011
    assert ticks.z[0] == pytest.approx(0.10, abs=0.01)
    assert ticks.pitch[0] == pytest.approx(np.pi / 2, abs=0.01)
    assert np.ptp(ticks.z[:2]) < 5e-5
    facts = next(event for event in fold.run.events() if event.kind == "hanging").facts
    assert facts["still"] is True
    early, late = fold.true_shape(-0.3), fold.true_shape(0.0)
    assert np.abs(late - early).max() < 0.001


def test_recorded_joints_pinch_the_strip_in_the_maker_s_model(fold: Folded) -> None:
    cell, strip = find_configs(None).cell(), find_configs(None).strip("denim")
    scene = scene_for(cell.installation, strip)
    held, wrong = scene.judge(carried_out(fold, strip))
    assert wrong == []
    assert held > 1000


def test_run_states_the_joint_limits_of_its_robot(fold: Folded) -> None:
    header = yaml.safe_load((fold.run.folder / RUN).read_text("utf-8"))
    assert header["joint_limits"] == FR3.content()


def test_measurements_agree_with_the_truth(fold: Folded) -> None:
    displacement = fold.result.displacement
    touch = fold.truth.touch
    assert displacement == pytest.approx(touch.displacement, abs=0.003)
    assert fold.result.layer_touch == pytest.approx(touch.time - fold.origin, abs=0.05)
    assert abs(displacement) < 0.006


def test_the_gap_workflow_reads_the_run_and_finds_nothing_wrong_with_it(
    fold: Folded, tmp_path: Path
) -> None:
    """Beside one that begins flat, since it fits two runs at least."""
    [flat] = written(tmp_path, folds(["normal", "fast"])[1:])
    strip = opened(Path(fold.result.run), flat)
    found = dict(zip((run.name for run in strip.runs), residuals(strip), strict=True))
    alone = SimpleNamespace(runs=[run for run in strip.runs if run.name != flat.name])
    robot = [found[run.name] for run in alone.runs]
    assert len(robot) == 1
    assert in_noise(alone, robot, "profile") < 4.0  # flat ones of the twin: 2.6
    assert in_noise(alone, robot, "contact_x") < 2.0


def test_replay_report_and_view_take_the_run(fold: Folded) -> None:
    folder = Path(fold.result.run)
    again = replay(folder)
    assert again.same, again.differences[:3]
    assert again.images > 2
    assert "hanging" in write_report(folder).read_text()
    assert viz_from_run(folder).stat().st_size > 100_000
