"""Measured motion: filtered as its torques are, and as sure as its encoders are."""

from collections.abc import Sequence

import numpy as np
import pytest
import yaml
from scipy.special import betainc

from cell.gap.subject.mechanism.recordings import Recording, repeat_noise
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.run_table import read_table
from tests.lab.exam import mechanisms as exam
from tests.support.mechanisms import PRESCRIBED, left, make_arm, opened, write_run

MODEL, SEED = "chain-2", 3
NOISE = 0.29  # of a run without a cause, in what its file states: a third more


def truths(weight: np.ndarray) -> dict[str, Sequence[float] | np.ndarray]:
    """True values of the library by cause, for joints of typical torques (2,) [N m]."""
    shares = {cause: share * weight for cause, (_, share) in exam.FIELDS.items()}
    return {
        **shares,
        "torque_bias": exam.BIAS * weight * (-1, 1),
        "torque_constant": [exam.CONSTANT_ERROR] * 2,
        "joint_elasticity": exam.TWIST / weight,
        "payload": [exam.PAYLOAD * 1.7],
        "sensor_delay": [exam.DELAY],
        "encoder_bias": [0.0, exam.ENCODER_BIAS],
    }


def test_noise_by_repeats_is_that_of_a_reading_whatever_their_clocks() -> None:
    rng = np.random.default_rng(1)
    found = []
    for t in np.cumsum(rng.uniform(0.004, 0.016, (3, 2000)), axis=1):
        x = rng.normal(0.0, 0.02, 2000)
        found.append(Recording("", "same", None, t, {"x": x}))
    assert repeat_noise(found, "x", "") == pytest.approx(0.02, rel=0.03)


@pytest.mark.parametrize("hidden", ["nothing", *truths(np.ones(2))])
def test_hidden_effect_of_a_mechanism_has_the_librarys_values(
    tmp_path, monkeypatch, hidden
):
    monkeypatch.setattr(exam, "RUNS", 2)
    monkeypatch.setattr(exam, "SPAN", 2.0)
    causes = [] if hidden == "nothing" else [hidden]
    file = exam.make_runs(tmp_path, MODEL, causes, 1.0, SEED, tmp_path / "made")
    mechanism = opened(file, tmp_path / "made" / "study-runs")
    truth = truths(exam.weights(exam.open_rig(tmp_path, MODEL), SEED))
    assert left(mechanism, **{cause: truth[cause] for cause in causes}) < NOISE
    assert (left(mechanism) > 3.0 * NOISE) == bool(causes)


def test_a_servo_that_yields_is_an_elastic_joint(tmp_path) -> None:
    """Its stiffness is the gear's, its command where the motor stands."""
    motors = {"shoulder": "a1", "elbow": "a2"}
    tracked = {
        f"e_{motor}": {"joint": joint, "is": "tracking", "sigma": 3e-4}
        for joint, motor in motors.items()
    }
    content = {**PRESCRIBED, "signals": PRESCRIBED["signals"] | tracked}
    file, runs = make_arm(tmp_path, 2, content=content)
    for run in runs.iterdir():
        table = read_table(run / "signals.parquet")
        for joint, motor in motors.items():
            table[f"e_{motor}"] = table[joint] - table[motor]
        write_run(run, table, {"mechanism": "arm"})
    arm = opened(file, runs)
    right = left(arm, joint_elasticity=[1 / 60, 1 / 30])
    assert right < 0.15 * left(arm)  # commands step, and joints follow a little later
    assert left(arm, joint_elasticity=[1 / 50, 1 / 30]) > 1.5 * right


def test_readings_are_bridged_over_a_moment_and_left_out_about_a_gap(tmp_path) -> None:
    file, runs = make_arm(tmp_path, 2, content=PRESCRIBED)
    whole = opened(file, runs).runs
    for run in runs.iterdir():
        table = read_table(run / "signals.parquet")
        kept = np.abs(table["t"] - 1.5) > 0.1
        table["shoulder"][1::2], table["t1"][::2] = np.nan, np.nan
        table["t2"][100] = np.inf
        write_run(run, {n: x[kept] for n, x in table.items()}, {"mechanism": "arm"})
    torn = opened(file, runs)
    assert left(torn) < 0.4
    for run, before in zip(torn.runs, whole, strict=True):
        assert len(before.samples) > len(run.samples) > 0.5 * len(before.samples)


STANDING = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody><body name="b">
<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><joint name="j" axis="0 1 0"/></body>
</worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>"""


@pytest.fixture
def standing(tmp_path) -> MechanismSubject:
    """A joint with friction of 0.5 N m that turns, stops, and stands under 0.3, 0 and
    0.7 N m.
    """
    t = np.arange(0.0, 9.0, 0.004)
    q = 1.5 * betainc(4, 4, np.clip(t / 3.0, 0.0, 1.0))
    v = np.gradient(q, t)
    moving = 0.1 * np.gradient(v, t) + 0.5 * np.tanh(v / 0.01)
    given = np.select([t < 3.0, t < 5.0, t < 7.0], [moving, 0.3, 0.0], 0.7)
    for k in range(2):
        head = {"mechanism": "one", "index": k}
        write_run(tmp_path / "runs" / f"{k}", {"t": t, "j": q, "tau": given}, head)
    (tmp_path / "one.xml").write_text(STANDING)
    content = {
        **PRESCRIBED,
        "name": "one",
        "model": "one.xml",
        "inputs": {"j": "position"},
        "signals": {"tau": {"actuator": "m", "is": "torque", "sigma": 0.01}},
        "uncertain": [{"actuator": "m", "field": "gain", "spread": "5%"}],
    }
    (tmp_path / "one.yaml").write_text(yaml.safe_dump(content))
    return opened(tmp_path / "one.yaml", tmp_path / "runs")


def test_friction_holds_a_joint_that_stands_up_to_its_limit(standing):
    run, rubs = standing.runs[0], {"dry_friction": np.array([0.5, 0.0])}
    found = standing.simulate([standing.stated(run, rubs)])[0].mean
    moves, stands, yields = (
        found[np.abs(run.samples.t - middle) < half]
        for middle, half in ((1.5, 0.5), (5.0, 1.5), (8.25, 0.75))
    )
    assert np.abs(moves).max() < 0.02
    assert np.abs(stands).max() < 0.01
    assert yields == pytest.approx(0.2, abs=0.01)


def test_an_error_of_a_number_that_is_stated_as_uncertain_is_no_effect(standing):
    names = {c.name for c in standing.scope.candidates}
    assert "torque_constant" not in names
    assert {"armature", "com_error"} <= names
