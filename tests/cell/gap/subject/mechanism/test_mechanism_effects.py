"""The library of effects: each is nothing at its null, something beyond it."""

from pathlib import Path

import numpy as np
import pytest

from cell.gap.subject.mechanism.effects import registry
from cell.gap.subject.mechanism.effects.compliance import SWAY
from cell.gap.subject.mechanism.subject import MechanismSubject
from drivers.base.readers import read_yaml
from drivers.base.types import Array
from tests.support.mechanisms import FORWARD, PRESCRIBED, make_arm, opened

CONTRACT = {*read_yaml(Path(__file__).with_name("effects.yaml"))["mechanism"]}
PENDULUMS = {"frame_tilt", "pivot_compliance", "wire_spring"}


@pytest.fixture(
    scope="module", params=[FORWARD, PRESCRIBED], ids=["forward", "prescribed"]
)
def arm(request, tmp_path_factory) -> MechanismSubject:
    folder = tmp_path_factory.mktemp(request.param["mode"])
    return opened(*make_arm(folder, 2, content=request.param, span=1.5))


def simulated(arm: MechanismSubject, effects: dict[str, Array]) -> Array:
    return arm.simulate([arm.stated(arm.runs[1], effects)])[0].mean


def test_the_library_has_what_the_contract_names() -> None:
    assert set(registry()) == CONTRACT | PENDULUMS


def test_a_base_is_tried_that_sways_a_few_times_slower_than_at_its_least(arm) -> None:
    sways = registry()["base_compliance"].parameters(arm.mechanism)
    along = next(p for p in sways if p.name == "compliance_x")
    moved = arm.mechanism.model.body_mass.sum()
    rate = (along.spread * moved) ** -0.5  # rad/s of the base with that compliance
    assert rate == pytest.approx(SWAY)


@pytest.mark.slow
def test_every_effect_is_null_to_the_bit_and_changes_something_beyond(arm) -> None:
    plain = simulated(arm, {})
    for candidate in (*arm.scope.candidates, *arm.scope.terms):
        for null in (candidate.null, candidate.with_shape().null):
            same = simulated(arm, {candidate.name: null})
            assert np.array_equal(same, plain), candidate.name
        moved = simulated(arm, {candidate.name: np.array(candidate.probes[-1][0])})
        assert np.nanmax(np.abs(moved - plain)) > 1e-9, candidate.name
