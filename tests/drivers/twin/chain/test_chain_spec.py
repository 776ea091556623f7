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
from drivers.twin.chain.spec import build

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


def test_hinges_together_bend_like_the_strip_whatever_their_number(strip: StripFile) -> None:
    model = describe(strip)
    rigidity = strip.rigidity * np.linspace(1.0, 3.0, CELLS)
    uneven = replace(model, mechanics=replace(model.mechanics, rigidity=rigidity))
    compliance = float(np.mean(1 / rigidity)) * strip.length
    for links in (10, 37):
        lumps = Lumps.of(uneven, links)
        assert float(np.sum(lumps.scale / lumps.stiffness)) == pytest.approx(compliance, rel=1e-9)


def test_absolute_mass_never_reaches_the_solver(strip: StripFile) -> None:
    heavy = Lumps.of(describe(strip), LINKS)
    light = Lumps.of(describe(strip.model_copy(update={"areal_density": 0.2})), LINKS)
    assert light.scale > 100 * heavy.scale
    for name in ("mass", "stiffness", "damping"):
        np.testing.assert_allclose(getattr(light, name), getattr(heavy, name), rtol=1e-9)


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
