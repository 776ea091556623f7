"""Runs of an exam: by hand no two alike, and as different from one another as their
level says.
"""

from pathlib import Path

import numpy as np
import pytest

from cell.record.files import TICKS
from tests.lab.exam import from_state, through_images
from tests.lab.exam.from_state import LEVELS, RunScatter
from tests.support.exam_cases import case


def test_a_sealed_run_by_hand_states_its_number_and_no_seed() -> None:
    header = {
        "policy": "motion:by-hand-71-3",
        "condition": "motion:by-hand-71-3",
        "index": 3,
        "strip": "denim",
        "plant_sha256": "0",
    }
    assert through_images._sealed_header(header) == {
        "policy": "by-hand-4",
        "condition": "by-hand-4",
        "index": 3,
        "strip": "denim",
    }


@pytest.mark.parametrize("level", ["half", "full"])
def test_runs_differ_by_as_much_as_their_level_says(level) -> None:
    drawn = [RunScatter.draw(level, 3, index) for index in range(400)]
    of = LEVELS[level]
    assert np.std([d.grip for d in drawn]) == pytest.approx(of.grip, rel=0.1)
    assert np.std([d.damping for d in drawn]) == pytest.approx(of.damping, rel=0.1)
    assert np.std([d.stiffness for d in drawn]) == pytest.approx(of.stiffness, rel=0.1)


@pytest.mark.slow
def test_a_chain_from_the_state_follows_the_law_of_its_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(from_state, "MOTIONS", ("fast",))
    monkeypatch.setattr(from_state, "LINKS", 40)
    plain = case("nothing", "nothing", {}).model_copy(update={"engine": "chain"})
    lawful = plain.model_copy(update={"causes": {"dahl": {"yield_curvature": 40.0}}})
    for name, made in (("plain", plain), ("again", plain), ("lawful", lawful)):
        from_state.make_runs(made, tmp_path / name)
    of = {
        n: (tmp_path / n / "00-fast" / TICKS).read_bytes()
        for n in ("plain", "again", "lawful")
    }
    assert of["plain"] == of["again"]
    assert of["plain"] != of["lawful"]
