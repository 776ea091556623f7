"""What the chain is built of: lumped fields, hinges, refusals."""

from dataclasses import dataclass, replace

import pytest

from drivers.errors import Unsupported
from drivers.strip.describe import describe
from drivers.strip.file import StripFile, paper_strip
from drivers.strip.model import BendingLaw, StripModel
from drivers.twin.chain import spec
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
