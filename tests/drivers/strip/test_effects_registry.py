"""The library of effects: complete, strict, absent when null, finite over its range."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_yaml
from drivers.strip.describe import describe, load_plant, load_strip
from drivers.strip.effects import apply_effects, check_effects, registry
from drivers.strip.effects.effect import Effect
from tests.support.effect_cases import (
    USUAL,
    affected,
    bare,
    denim,
    folds,
    levels,
    usual,
)

CONTRACT = read_yaml(Path(__file__).with_name("effect_contract.yaml"))
ABSENT = {"stretch", "end_slip", "grip_slip"}  # nulls at infinity
EFFECTS = list(registry().values())
CASES = [(effect, values) for effect in EFFECTS for values in levels(effect)]
of_effect = pytest.mark.parametrize("effect", EFFECTS, ids=[e.name for e in EFFECTS])


def _middle(effect: Effect) -> dict[str, float]:
    """Values at which the effect shows: its switch between null and its end."""
    switch = effect.parameters[0]
    low, high = switch.stated_range
    strong = np.sqrt(low * high) if low > 0 else 0.3 * high
    if USUAL.get(switch.name, np.inf) <= high:
        strong = USUAL[switch.name]
    elif effect.name == "grip_slip":
        strong = 0.1
    elif effect.name == "stretch":
        strong = 5.0
    return {p.name: usual(effect, p) for p in effect.parameters[1:]} | {
        switch.name: float(strong)
    }


def _nulls(effect: Effect) -> dict[str, float]:
    at = {p.name: p.stated_value(p.start) for p in effect.parameters if p.is_amount}
    return {p.name: USUAL.get(p.name, 1.0) for p in effect.parameters} | at


def test_registry_holds_the_names_and_parameters_of_the_contract() -> None:
    found = {
        e.name: [e.of, " ".join(p.name for p in e.parameters if p.role != "shape")]
        for e in EFFECTS
    }
    assert {name: found[name] for name in CONTRACT} == CONTRACT


@of_effect
def test_effect_at_null_is_the_very_same_description(effect: Effect) -> None:
    model = bare()
    assert apply_effects(model, {}) is model
    assert effect.parameters[0].inverse == (effect.name in ABSENT)
    assert apply_effects(model, {effect.name: _nulls(effect)}) is model


@pytest.mark.parametrize("path", ["triangular", "circular"])
def test_folds_stay_finite_over_the_range_of_every_parameter(path: str) -> None:
    models = [affected(effect.name, **values) for effect, values in CASES]
    for (effect, values), motion in zip(CASES, folds(models, path), strict=True):
        assert motion.touch is not None, (effect.name, values)
        assert np.isfinite(motion.contact_x).all(), (effect.name, values)
        assert np.isfinite(motion.shapes).all(), (effect.name, values)


@of_effect
def test_effect_survives_a_file(effect: Effect, tmp_path: Path) -> None:
    plant = denim(effects={effect.name: _middle(effect)})
    path = tmp_path / "denim.yaml"
    path.write_text(yaml.safe_dump(plant.model_dump(mode="json", by_alias=True)))
    assert load_plant(path) == plant
    if effect.of == "strip":
        assert load_strip(path) == plant
    else:
        with pytest.raises(
            ConfigurationError, match=f"effects.{effect.name}: unknown effect"
        ):
            load_strip(path)


@of_effect
def test_effect_refuses_unknown_parameters(effect: Effect) -> None:
    good = _middle(effect)
    first = effect.parameters[0]
    check_effects({effect.name: good}, "here", [effect.of])
    for wrong, why in (
        (good | {"colour": 1.0}, "unknown parameter"),
        ({k: v for k, v in good.items() if k != first.name}, "is missing"),
        (good | {first.name: first.stated_range[1] * 2 + 1}, "out of range"),
    ):
        with pytest.raises(ConfigurationError, match=why):
            check_effects({effect.name: wrong}, "here", [effect.of])


@pytest.mark.parametrize("name", ["seam", "crease", "hem_mass"])
def test_place_beside_the_strip_is_refused_by_file_and_key(
    name: str, tmp_path: Path
) -> None:
    values = _middle(registry()[name]) | {"position": 0.7}
    path = tmp_path / "denim.yaml"
    content = denim(effects={name: values}).model_dump(mode="json", by_alias=True)
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(
        ConfigurationError, match=rf"denim.yaml: effects.{name}.position: 0.7"
    ):
        load_strip(path)
    with pytest.raises(ConfigurationError, match=rf"effects.{name}.position: 0.7"):
        describe(denim(effects={name: values}))
