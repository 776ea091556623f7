"""Force on the gripper as a channel: it separates what images alone cannot."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.bias import model_error
from cell.gap.subject.strip.subject import Strip, open_strip
from cell.gap.subject.strip.synthetic import Instruments, write_fold
from tests.support.gap_strip_cases import STRIP, folds, in_noise, residuals, whitened, written

LATE = np.array([0.012])  # s
FEELING = Instruments(force=0.001)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Strip:
    """Folds of an arm that reports its places late, and the force of the strip."""
    root = tmp_path_factory.mktemp("late") / "runs"
    written(root, folds(["fast", "early-shake"], {"control_delay": {"time": LATE[0]}}), FEELING)
    return open_strip(STRIP, find_runs([root]))


def test_force_separates_a_late_arm_from_a_late_camera(late: Strip) -> None:
    arm = residuals(late, {"control_delay": LATE})
    camera = residuals(late, {"camera_latency": -LATE})
    for channel in ("profile", "contact_x"):
        assert in_noise(late, camera, channel) == pytest.approx(
            in_noise(late, arm, channel), rel=0.1
        )
    left = [whitened(late, found)[force_rows(late)] for found in (arm, camera)]
    assert np.mean(left[0] ** 2) < 1.5
    assert np.sum(left[1] ** 2) - np.sum(left[0] ** 2) > 40.0


def test_where_force_is_measured_it_weighs_the_strip(late: Strip) -> None:
    assert [p.name for p in late.scope.base][-1] == "areal_density"
    base = np.array([p.start for p in late.scope.base])
    heavier = base * [1.0, 1.0, 1.1]
    stated, changed = ([r.mean for r in residuals_at(late, at)] for at in (base, heavier))
    force = [run.samples.channel == "force" for run in late.runs]
    for here, there, rows in zip(stated, changed, force, strict=True):
        assert np.abs(there - here)[rows].max() > 0.001
        assert np.nanmax(np.abs(there - here)[~rows]) < 1e-4


def test_runs_without_a_camera_share_the_error_of_damping_and_none_of_perception(
    late: Strip,
) -> None:
    for run in late.runs:
        assert set(run.common) == {"damping"}
        slopes = run.content.slopes["damping"]
        np.testing.assert_allclose(run.common["damping"], model_error().damping * slopes)


def force_rows(strip: Strip) -> NDArray[np.bool_]:
    return np.concatenate([run.samples.channel == "force" for run in strip.runs])


def residuals_at(strip: Strip, base):
    from cell.gap.subject.subject import Request

    return strip.simulate([Request(r, base, {}, np.zeros(len(r.local))) for r in strip.runs])


def test_what_a_tare_left_and_a_late_report_are_unknowns_of_each_run(late: Strip) -> None:
    names = [p.name for p in late.runs[0].local]
    assert {"force_x", "force_z", "force_delay"} <= set(names)
    rows = late.runs[0].samples.channel == "force"
    slopes = late.runs[0].content.slopes
    assert slopes["force_x"][rows].min() == pytest.approx(-1.0)
    assert not slopes["force_x"][~rows].any()
    assert np.abs(slopes["force_delay"][rows]).max() > 0.01


def test_force_changes_nothing_else_of_a_run(tmp_path: Path) -> None:
    (fold,) = folds(["fast"])
    for name, by in (("blind", Instruments()), ("feeling", FEELING)):
        write_fold(tmp_path / name, "denim", fold, by, np.random.default_rng(5))
    blind, feeling = (pq.read_table(tmp_path / n / "ticks.parquet") for n in ("blind", "feeling"))
    for name in blind.column_names:
        assert np.array_equal(feeling[name].to_numpy(), blind[name].to_numpy(), equal_nan=True)
    same = [(tmp_path / n / "profile.parquet").read_bytes() for n in ("blind", "feeling")]
    assert same[0] == same[1]
