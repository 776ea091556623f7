"""The scorer of the exam and its statistics."""

from collections.abc import Sequence

import pytest

from cell.gap.subject.run_folders import RunFolder, find_runs
from cell.gap.verdict.schema import Verdict
from tests.lab.exam.case import Case
from tests.lab.exam.score import Outcome, oracle, result, score
from tests.lab.exam.targets import Rate
from tests.support.exam_cases import case, few_runs, named, verdict
from tests.support.gap_strip_cases import STRIP, denim


def of(kind: str, *answer: str) -> Case:
    return case("a", kind, {name: {} for name in answer})


@pytest.mark.parametrize(
    ("said", "hidden", "right"),
    [
        (named("desk_tilt"), of("single", "desk_tilt"), "right_strict"),
        (named("air_drag"), of("single", "desk_tilt"), "wrong_name"),
        (named("desk_tilt", "air_drag"), of("single", "desk_tilt"), "wrong_name"),
        (named("camera_latency"), of("single", "control_delay"), "right_class"),
        (verdict("no_gap"), of("single", "desk_tilt"), "abstained"),
        (verdict("unexplained"), of("single", "desk_tilt"), "abstained"),
        (named("seam", "desk_tilt"), of("pair", "desk_tilt", "seam"), "right_strict"),
        (named("seam"), of("pair", "desk_tilt", "seam"), "partly"),
        (named("seam", "air_drag"), of("pair", "desk_tilt", "seam"), "wrong_name"),
        (
            named("contact_bias", "seam"),
            of("pair", "homography_shift", "seam"),
            "right_class",
        ),
        (named("contact_bias"), of("pair", "homography_shift", "seam"), "partly"),
        (named("desk_tilt"), of("nothing"), "false_alarm"),
        (verdict("unexplained"), of("nothing"), "gap_claimed"),
        (verdict("no_gap"), of("nothing"), "correct_no_gap"),
        (verdict("unexplained"), of("outside"), "correct_abstention"),
        (named("desk_tilt"), of("outside"), "wrong_name"),
        (verdict("ambiguous", classes=[["a", "b"]]), of("outside"), "wrong_name"),
        (verdict("no_gap"), of("outside"), "abstained"),
    ],
)
def test_a_verdict_is_worth_what_was_hidden(
    said: Verdict, hidden: Case, right: str
) -> None:
    assert result(said, hidden) == right


@pytest.mark.parametrize(
    ("classes", "answer", "right"),
    [
        ([["desk_tilt", "air_drag"]], ("desk_tilt",), "right_class"),
        ([["seam", "air_drag"]], ("desk_tilt",), "abstained"),
        ([["seam", "air_drag"]], ("desk_tilt", "seam"), "partly"),
        (
            [["seam", "air_drag"], ["desk_tilt", "crease"]],
            ("desk_tilt", "seam"),
            "right_class",
        ),
    ],
)
def test_classes_are_right_where_they_hold_the_answer(
    classes: list[list[str]], answer: tuple[str, ...], right: str
) -> None:
    kind = "pair" if len(answer) > 1 else "single"
    assert result(verdict("ambiguous", classes=classes), of(kind, *answer)) == right


def scored(said: Verdict, hidden: Case) -> Outcome:
    return score(said, hidden, denim())


def test_parameters_are_held_against_the_truth_of_equal_laws_only() -> None:
    said = named(
        "seam", parameters={"factor": (3.0, 2.0, 3.5), "position": (0.3, 0.29, 0.31)}
    )
    alike = case(
        "a", "single", {"seam": {"factor": 2.5, "position": 0.4, "width": 0.02}}
    )
    unlike = case("b", "single", {}, causes={"plate": {"size": 1.0}}, answer=("seam",))
    factor, position = scored(said, alike).parameters
    assert factor.switch
    assert factor.covered
    # of the distance from no seam, factor 1
    assert factor.error == pytest.approx(0.5 / 1.5)
    assert not position.covered
    assert scored(said, unlike).result == "right_strict"
    assert scored(said, unlike).parameters == scored(said, unlike).base == ()


def test_the_base_is_held_against_its_factors() -> None:
    said = verdict(
        "no_gap", base={"bending_length": (1.1, 1.0, 1.2)}, unit=denim().bending_length
    )
    [length] = scored(said, case("a", "nothing", {}, stiffness=1.15)).base
    assert length.covered
    [length] = scored(said, case("a", "nothing", {}, stiffness=0.9)).base
    assert not length.covered


def test_wilson_agrees_with_its_published_values() -> None:
    """Newcombe 1998, Stat. Med. 17, table I, method 3."""
    assert Rate(81, 263).interval == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert Rate(15, 148).interval == pytest.approx((0.0624, 0.1605), abs=5e-5)
    assert Rate(0, 20).interval == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert Rate(1, 29).interval == pytest.approx((0.0061, 0.1718), abs=5e-5)


@pytest.fixture(scope="module")
def tilted(tmp_path_factory: pytest.TempPathFactory) -> Sequence[RunFolder]:
    """Folds on a desk that is tilted by 20 mrad."""
    folder = tmp_path_factory.mktemp("tilted")
    few_runs(case("a", "single", {"desk_tilt": {"angle": 0.02}}), folder)
    return find_runs([folder])


@pytest.mark.slow
def test_knowing_the_truth_closes_the_gap(tilted: Sequence[RunFolder]) -> None:
    equal = case("a", "single", {"desk_tilt": {"angle": 0.02}})
    similar = case(
        "b", "single", {}, causes={"slope": {"rise": 1.0}}, answer=("desk_tilt",)
    )
    beside = case(
        "c", "single", {}, causes={"slope": {"rise": 1.0}}, answer=("contact_bias",)
    )
    held = [tilted[-1].name]
    first, second, wrong = (
        oracle(c, STRIP, tilted, held) for c in (equal, similar, beside)
    )
    assert first.after < 0.5
    assert first.shrink > 0.8
    assert second.after == pytest.approx(first.after, abs=0.2)
    assert wrong.shrink < 0.8
