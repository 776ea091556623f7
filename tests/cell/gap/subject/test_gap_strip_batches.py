"""Which motions of a strip are simulated together."""

import pickle
from dataclasses import replace
from pathlib import Path

from cell.gap.subject.strip.scope import candidate, file_values
from cell.gap.subject.strip.subject import AGEING
from drivers.strip.describe import describe, load_strip
from drivers.strip.effects import registry
from drivers.strip.law import LAW_TERMS, with_law

STRIP = load_strip(Path("configs/strips/denim.yaml"))


def test_only_what_ages_depends_on_the_number_of_the_run() -> None:
    def depends(amounts: dict[str, dict[str, float]], law: dict[str, float]) -> bool:
        seen = [with_law(describe(STRIP, amounts, index), law) for index in (0, 9)]
        fresh, worn = (pickle.dumps(replace(model, index=0)) for model in seen)
        return fresh != worn

    for name, effect in registry().items():
        values = file_values(effect, candidate(effect, STRIP, 0.0).probes[-1][0])
        assert depends({name: values or {}}, {}) is (name in AGEING), name
    for name in LAW_TERMS:
        assert depends({}, {name: 0.01}) is (name in AGEING), name
