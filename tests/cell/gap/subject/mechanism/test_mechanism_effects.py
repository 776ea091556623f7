"""The library of effects: each is nothing at its null, something beyond it."""

from dataclasses import replace

import numpy as np
import pytest

from cell.gap.subject.mechanism.effects import describing_terms, effect_of, registry
from cell.gap.subject.mechanism.subject import MechanismSubject, open_mechanism
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.subject import Request, Residuals
from drivers.types import Array
from tests.support.mechanisms import FORWARD, PRESCRIBED, make_arm

CONTRACT = {
    "dry_friction", "quadratic_damping", "presliding", "cable_spring", "joint_elasticity",
    "backlash", "armature", "payload", "com_error", "torque_constant", "torque_bias",
    "torque_ripple", "saturation", "control_delay", "sensor_delay", "encoder_bias",
    "encoder_scale", "base_tilt", "air_drag", "contact_friction", "link_inertia",
}  # fmt: skip
PENDULUMS = {"frame_tilt", "pivot_compliance", "wire_spring"}


@pytest.fixture(scope="module", params=[FORWARD, PRESCRIBED], ids=["forward", "prescribed"])
def arm(request, tmp_path_factory) -> MechanismSubject:
    folder = tmp_path_factory.mktemp(request.param["mode"])
    file, runs = make_arm(folder, 2, content=request.param, span=1.5)
    return open_mechanism(file, find_runs([runs]))


def simulated(arm: MechanismSubject, effects: dict[str, Array]) -> Residuals:
    run = arm.runs[1]
    base = np.array([p.start for p in arm.scope.base])
    own = np.array([p.start for p in run.local])
    return arm.simulate([Request(run, base, effects, own)])[0]


def test_the_library_has_what_the_contract_names() -> None:
    assert set(registry()) == CONTRACT | PENDULUMS


@pytest.mark.slow
def test_every_effect_is_null_to_the_bit_and_changes_something_beyond(arm) -> None:
    plain = simulated(arm, {})
    for candidate in (*arm.scope.candidates, *describing_terms(arm.opened.mechanism)):
        for null in (candidate.null, candidate.with_shape().null):
            same = simulated(arm, {candidate.name: null})
            assert np.array_equal(same.mean, plain.mean), candidate.name
        moved = simulated(arm, {candidate.name: np.array(candidate.probes[-1][0])})
        assert np.nanmax(np.abs(moved.mean - plain.mean)) > 1e-9, candidate.name


@pytest.mark.slow
def test_a_law_compiled_into_the_engine_acts_as_the_law_itself(arm) -> None:
    """A steady torque by the compiled hook is what a motor's constant force would be."""
    if arm.opened.mechanism.mode != "forward":
        pytest.skip("the hook serves simulations")
    bias = np.array([0.05, -0.02])
    assert effect_of("torque_bias").law is not None
    case = arm._case(Request(arm.runs[0], np.array([p.start for p in arm.scope.base]),
                             {"torque_bias": bias},
                             np.array([p.start for p in arm.runs[0].local])))  # fmt: skip
    (by_law,) = arm._engine.predict([case])
    edit = case.edit

    def by_motor(fields) -> None:
        edit(fields)
        fields["jnt_user"][:, 4:] = 0.0
        fields["actuator_biasprm"][:, 0] += bias

    (by_force,) = arm._engine.predict([replace(case, edit=by_motor)])
    assert np.abs(by_law[:2] - by_force[:2]).max() < 1e-12
