"""What the chain is built of: lumped fields, hinges, refusals."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest

from drivers.errors import Unsupported
from drivers.strip.describe import describe
from drivers.strip.file import StripFile, paper_strip
from drivers.strip.model import CELLS, BendingLaw, StripModel
from drivers.twin.chain import spec
from drivers.twin.chain.lumps import Lumps
from drivers.twin.chain.spec import Layers, build

LINKS = 24


@pytest.fixture(scope="module")
def strip() -> StripFile:
    return paper_strip(0.1, 0.005)


@pytest.fixture(scope="module")
def model(strip: StripFile) -> StripModel:
    return describe(strip)


def with_law(model: StripModel, law: BendingLaw) -> StripModel:
    return replace(model, mechanics=replace(model.mechanics, law=law))


def moments(model: StripModel, curvature: float) -> np.ndarray:
    """Moments at the inner hinges of a chain bent to a uniform curvature [N m]."""
    chain = build(model, LINKS).compile()
    state = mujoco.MjData(chain)
    state.qpos[:] = curvature * Lumps.of(model, LINKS).reach
    mujoco.mj_forward(chain, state)
    return -state.qfrc_spring[1:-1] / Lumps.of(model, LINKS).scale


def test_every_build_is_a_fresh_one(model: StripModel) -> None:
    assert build(model, LINKS).to_xml() == build(model, LINKS).to_xml()


def test_hinges_at_both_clamps_stand_for_half_a_link(model: StripModel) -> None:
    chain = build(model, LINKS).compile()
    spans = Lumps.of(model, LINKS).spans
    for values in (chain.jnt_stiffness, chain.dof_damping):
        ends = np.array([spans[0], spans[-1]])
        np.testing.assert_allclose(values[[0, -1]] * ends, 2 * values[1] * spans[0], rtol=1e-12)


def test_hinges_together_bend_like_the_strip_whatever_their_number(strip: StripFile) -> None:
    model = describe(strip)
    rigidity = strip.rigidity * np.linspace(1.0, 3.0, CELLS)
    uneven = replace(model, mechanics=replace(model.mechanics, rigidity=rigidity))
    compliance = float(np.mean(1 / rigidity)) * strip.length
    for links in (10, 37):
        lumps = Lumps.of(uneven, links)
        assert float(np.sum(lumps.scale / lumps.stiffness)) == pytest.approx(compliance, rel=1e-9)


def test_moment_of_a_bent_chain_is_rigidity_times_curvature(
    strip: StripFile, model: StripModel
) -> None:
    np.testing.assert_allclose(moments(model, 20.0), strip.rigidity * 20.0, rtol=1e-9)


def test_cubic_term_stiffens_as_stated(strip: StripFile, model: StripModel) -> None:
    stiffer = with_law(model, BendingLaw(cubic=2e-4))
    expected = strip.rigidity * 20.0 * (1 + 2e-4 * 20.0**2)
    np.testing.assert_allclose(moments(stiffer, 20.0), expected, rtol=1e-9)


def test_rest_curvature_turns_the_free_end_up(strip: StripFile, model: StripModel) -> None:
    curled = replace(model, mechanics=replace(model.mechanics, rest_curvature=np.full(CELLS, 5.0)))
    assert float(Lumps.of(curled, LINKS).rest.sum()) == pytest.approx(5.0 * strip.length)
    np.testing.assert_allclose(moments(curled, 0.0), -strip.rigidity * 5.0, rtol=1e-9)


def test_absolute_mass_never_reaches_the_solver(strip: StripFile) -> None:
    heavy = Lumps.of(describe(strip), LINKS)
    light = Lumps.of(describe(strip.model_copy(update={"areal_density": 0.2})), LINKS)
    assert light.scale > 100 * heavy.scale
    for name in ("mass", "stiffness", "damping"):
        np.testing.assert_allclose(getattr(light, name), getattr(heavy, name), rtol=1e-9)


def test_null_law_builds_the_very_same_chain(strip: StripFile, model: StripModel) -> None:
    null = {"bending_hysteresis": {"yield_curvature": 0.0}, "nonlinear_bending": {"cubic": 0.0}}
    same = describe(strip.model_copy(update={"effects": null}))
    assert build(same, LINKS).to_xml() == build(model, LINKS).to_xml()


def test_unknown_part_of_a_description_is_refused_unless_null(
    model: StripModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    @dataclass(frozen=True)
    class Magnetic(BendingLaw):
        field_strength: float = 0.0

    known = {**spec.KNOWN_FIELDS, Magnetic: spec.KNOWN_FIELDS[BendingLaw]}
    monkeypatch.setattr(spec, "KNOWN_FIELDS", known)
    build(with_law(model, Magnetic()), LINKS)
    with pytest.raises(Unsupported, match="field_strength"):
        build(with_law(model, Magnetic(field_strength=1.0)), LINKS)


def test_bend_of_a_fold_belongs_to_neither_layer() -> None:
    angle = np.concatenate([np.zeros(10), np.linspace(0, np.pi, 9), np.full(5, np.pi)])
    layers = Layers.of(angle)
    assert np.cos(angle[layers.lower]) > 0.7
    assert np.cos(angle[layers.lower + 1]) < 0.71
    assert np.cos(angle[layers.upper]) < -0.7
    assert np.cos(angle[layers.upper - 1]) > -0.71
