"""Experiences are kept on disk, and correct the folds that come after."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from cell.folding.correction import (
    BiasKey,
    Correction,
    correction_of,
    experience_of,
    learned_correction,
)
from cell.folding.experience import NEWEST, Experience, Memory
from cell.folding.fold import _learn
from cell.orchestrator.outcome import Outcome
from cell.perception.strip_measurement import SeenTouch
from cell.record.files import TICKS
from policies.planned import Planned
from policies.policy import FoldPrediction, ParameterEstimate
from policies.registry import make_policy
from tests.support.made_folds import STRIP
from tests.support.refusals import refusal
from tests.support.requests import request_for

SUBJECT = BiasKey("adaptive@1", "denim", "a")
NUMBER = ParameterEstimate(0.02, 0.019, 0.021)
PREDICTED = FoldPrediction(-0.001, 0.0005, NUMBER, NUMBER, NUMBER, blind=False)


@pytest.fixture
def memory(tmp_path: Path) -> Memory:
    return Memory("cell", tmp_path)


def folded(run: str, **facts: float) -> Experience:
    """What a fold in `run` taught."""
    return Experience(run, "adaptive", "denim", "a", "camera", **facts)


def outcome(
    displacement: float, predicted: FoldPrediction | None = PREDICTED
) -> Outcome:
    l1, l2 = 0.3 + displacement / 2, 0.3 - displacement / 2
    touch = SeenTouch(5.0, 0.3, l1, l2, confidence=1.0, distance=0.001)
    return Outcome("layer_touch", "the layers touch", 0, touch, -0.002, 14.0, predicted)


def test_experiences_come_back_in_order_and_a_torn_line_is_skipped(
    memory: Memory,
) -> None:
    first = folded("r0", displacement=0.001)
    second = replace(first, run="r1", kind="ruler", displacement=0.0, rig=0.002)
    memory.add(first)
    with memory.path.open("ab") as file:
        file.write(b'{"run": "r2", "policy"')
    memory.add(second)
    assert memory.experiences() == (first, second)


def test_what_cannot_be_set_aside_or_taken_out_is_not_forgotten(
    memory: Memory, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory.add(folded("r0"))
    before = memory.path.read_bytes()
    written: list[Path] = []

    def filling(room: int, path: Path, content: bytes) -> None:
        """Write to a disk with room for as many files."""
        if len(written) >= room:
            raise OSError(28, "No space left on device")
        written.append(path)
        path.write_bytes(content)

    for room in range(2):
        written.clear()
        replacing = partial(filling, room)
        monkeypatch.setattr("cell.folding.experience.replace_file", replacing)
        with refusal("No space left"):
            memory.forget()
        assert memory.path.read_bytes() == before
    (aside,) = written
    assert aside.read_bytes() == before


def test_the_newest_experiences_are_in_use_and_all_bound_the_corrections(
    memory: Memory,
) -> None:
    first = folded("r", aim=-0.004, place=0.003)
    memory.add(first)
    for number in range(NEWEST):
        memory.add(replace(first, run=f"r{number}", aim=0.001, place=-0.001))
    assert [one.run for one in memory.experiences()] == [
        f"r{number}" for number in range(NEWEST)
    ]
    assert memory.largest_corrections() == (-0.004, 0.003)


def test_forgetting_sets_aside_and_overwrites_nothing_that_was_set_aside(
    memory: Memory,
) -> None:
    kept: dict[Path, bytes] = {}
    assert memory.forget() is None
    for number in range(3):
        memory.add(folded(f"r{number}"))
        content, aside = memory.path.read_bytes(), memory.forget()
        assert aside is not None
        assert memory.experiences() == ()
        kept[aside] = content
        if number == 1:
            first = next(iter(kept))
            first.unlink()  # the operator moves it elsewhere
            del kept[first]
    assert {path: path.read_bytes() for path in kept} == kept


def test_one_run_is_forgotten_and_all_others_are_kept(
    memory: Memory, tmp_path: Path
) -> None:
    kept, gone = folded("r0"), folded("r1")
    for one in (kept, gone, replace(gone, kind="ruler", rig=0.001)):
        memory.add(one)
    aside = memory.forget(tmp_path / "r1")
    assert len(aside.read_bytes().splitlines()) == 2
    assert memory.experiences() == (kept,)
    assert memory.forget(tmp_path / "r1") is None


def test_switched_off_stays_off_until_switched_on(memory: Memory) -> None:
    parent = memory.path.parent
    memory.switch(on=False)
    assert Memory("cell", parent).is_off
    memory.switch(on=True)
    assert not Memory("cell", parent).is_off


@pytest.mark.parametrize(
    "line", ['{"run": 1}', '{"run": "r", "displacement": 1e9}', "[]", "x"]
)
def test_a_line_that_holds_no_experience_is_skipped(memory: Memory, line: str) -> None:
    memory.path.write_text(line + "\n")
    assert memory.experiences() == ()


def test_the_second_fold_aims_at_the_opposite_of_the_first_ones_bias(
    memory: Memory,
) -> None:
    first = experience_of("r0", SUBJECT, outcome(0.002), Correction())
    assert first.displacement == pytest.approx(0.003)  # measured +2 mm, predicted -1 mm
    memory.add(first)
    found = learned_correction(memory, SUBJECT)
    assert found.seen == pytest.approx(0.003, rel=0.1)
    assert str(found.sentence()).startswith("aimed -2.9 mm")


def test_a_correction_is_never_larger_than_the_limit(memory: Memory) -> None:
    for number in range(5):
        one = folded(f"r{number}", displacement=0.03)
        memory.add(replace(one, policy=SUBJECT.policy))
    assert learned_correction(memory, SUBJECT).seen == pytest.approx(0.008)


def test_experiences_of_other_weights_teach_nothing(memory: Memory) -> None:
    memory.add(replace(folded("r0", displacement=0.003), policy="adaptive@2"))
    assert learned_correction(memory, SUBJECT).seen == 0.0


def test_folds_without_touch_or_blind_or_stopped_or_unread_teach_nothing(
    tmp_path: Path,
) -> None:
    (tmp_path / TICKS).mkdir()
    assert "nothing was learned" in _learn(
        request_for("denim", "adaptive", tmp_path), outcome(0.0), tmp_path
    )
    good, blind = outcome(0.0), outcome(0.001, replace(PREDICTED, blind=True))
    for one in (blind, replace(good, name="force"), replace(good, touch=None)):
        assert experience_of("r", SUBJECT, one, Correction()) is None


def test_edges_are_learned_as_if_they_had_been_laid_without_a_correction() -> None:
    taut = Correction()
    shifted = Correction(place=-0.002)
    plain = experience_of("r0", SUBJECT, outcome(0.0), taut)
    again = experience_of(
        "r0", SUBJECT, replace(outcome(0.0), edge_offset=0.0), shifted
    )
    assert plain.edges == pytest.approx(-0.002)
    assert again.edges == pytest.approx(plain.edges)
    assert str(shifted.sentence()).startswith("laid the edge +2.0 mm")


def test_a_record_states_the_correction_that_was_used() -> None:
    used = Correction(0.001, None, 0.002)
    again = correction_of(used.facts())
    assert (again.seen, again.place) == (used.seen, used.place)
    assert correction_of(None).seen == 0.0


@pytest.mark.slow
def test_a_planned_fold_of_the_rod_comes_out_where_the_bias_is_corrected() -> None:
    plain, corrected = Planned(), Planned()
    assert Correction(0.004).apply(corrected) is not None
    for policy in (plain, corrected):
        policy.reset(STRIP, 0.1, 1)
    # A rise of one millimetre moves d by 0.95 mm (reference: the slope dd/dr of raised
    # triangles).
    moved = plain.rises - corrected.rises
    assert np.allclose(moved, 0.004 / 0.95, atol=1e-3)


def test_only_policies_that_steer_by_a_model_are_corrected() -> None:
    assert Correction(0.001).apply(make_policy("triangular")) is None
    assert Correction(0.001).apply(make_policy("adaptive")) is not None
