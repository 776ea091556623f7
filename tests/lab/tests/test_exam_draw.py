"""What is drawn for the exam can be folded, and shows."""

import numpy as np
import pytest

from cell.gap.effect_size import GapModel, draw_strengths
from cell.gap.subject.strip.synthetic import BENCH
from drivers.strip.effects import registry
from tests.lab.exam import cases as drawing
from tests.lab.exam.case import STRENGTHS
from tests.lab.exam.cases import draw_case, excess_of_each, standard_gap_model
from tests.lab.exam.from_state import MOTIONS, plant_of
from tests.support.gap_strip_cases import denim


@pytest.fixture(scope="module")
def model() -> GapModel:
    return standard_gap_model(denim(), MOTIONS, BENCH)


@pytest.mark.slow
def test_effects_that_cancel_each_leave_next_to_nothing(model: GapModel) -> None:
    twins = {"camera_latency": {"time": 0.03}, "control_delay": {"time": 0.03}}
    assert model.excess([{k: v} for k, v in twins.items()]).min() > 1.0
    assert excess_of_each(model, twins).max() < 0.3


def test_different_effects_keep_their_gaps(model: GapModel) -> None:
    both = {
        "homography_shift": {"x": 0.004, "z": 0.0},
        "hem_mass": {"mass": 0.001, "position": 0.5, "width": 0.02},
    }
    each = excess_of_each(model, both)
    assert each.min() > 1.0
    assert (each <= 1.1 * model.excess([{k: v} for k, v in both.items()])).all()


@pytest.mark.slow
def test_a_slip_is_as_strong_as_asked_or_is_not_drawn(model: GapModel) -> None:
    effect = registry()["grip_slip"]
    strengths = draw_strengths(effect, denim(), np.random.default_rng(0))
    found = {
        s: model.fraction(strengths, target, drawing.JUMP * target)
        for s, target in STRENGTHS.items()
    }
    drawn = {s: share for s, share in found.items() if share is not None}
    assert 1 <= len(drawn) < len(found)
    for strength, share in drawn.items():
        excess = model.excess([{"grip_slip": strengths.at(share)}])[0]
        assert 1.0 <= excess / STRENGTHS[strength] <= drawing.JUMP


@pytest.mark.slow
def test_a_single_effect_is_as_strong_as_asked_on_the_plant_that_hides_it() -> None:
    weak, medium = (draw_case("state", "single", i, 5) for i in range(2))
    for case, target in ((weak, STRENGTHS["weak"]), (medium, STRENGTHS["medium"])):
        assert case.motions == "standard"
        plant = standard_gap_model(plant_of(case), MOTIONS, BENCH)
        assert plant.excess([case.effects])[0] == pytest.approx(target, rel=0.3)


def test_half_of_the_plants_from_the_state_are_not_the_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plants = [draw_case("state", "nothing", i, 5).plant for i in range(2)]
    assert plants == ["another engine", "the model itself"]
    values = {"coefficient": 1.0, "yield_curvature": 9.0, "slope": 0.5, "cubic": 1e-5}
    monkeypatch.setattr(
        drawing, "_visible_effect", lambda case, *_: (case.strip, values)
    )
    lawful = draw_case("state", "single", 6, 5)
    assert lawful.plant == "another law"
    assert set(lawful.causes) == {"oblique_drag"}
    assert lawful.answer == ("air_drag",)
    assert not lawful.effects
