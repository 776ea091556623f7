"""The scorer of the exam."""

import pytest

from cell.gap.verdict.schema import Verdict
from tests.lab.exam.case import Case
from tests.lab.exam.score import Outcome, result, score
from tests.support.exam_cases import case, named, verdict
from tests.support.gap_strip_cases import denim


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
