"""The list of bugs put in by hand still fits the code that it is about."""

import ast
from pathlib import Path

import pytest

from tests.lab.mutant_draw import ROOMS, drawn, judges, mutants
from tests.lab.mutants import ROOT, Mutant, Unusable, listed

MUTANTS = listed()
GUARD = """
def safe(force: float, near: bool, held: bool) -> bool:
    if abs(force) < 2.0:
        return held or not near
    raise ValueError(f"{force + 1}")
"""


@pytest.mark.parametrize(
    "mutant", MUTANTS, ids=lambda mutant: mutant.name.replace(" ", "-")
)
def test_mutant_applies_once_and_is_still_a_program(mutant: Mutant) -> None:
    text = (ROOT / mutant.file).read_text("utf-8")
    assert mutant.old != mutant.new
    ast.parse(mutant.apply_to(text))
    assert mutant.tests
    assert all((ROOT / test.partition("::")[0]).is_file() for test in mutant.tests)


def test_mutant_whose_text_is_gone_is_an_error() -> None:
    gone = Mutant("gone", "README.md", "a text that stands nowhere", "", ())
    with pytest.raises(Unusable, match="0 times"):
        gone.apply_to("another text")


def test_every_small_change_of_a_guard_is_a_mutant(tmp_path: Path) -> None:
    (tmp_path / "guard.py").write_text(GUARD)
    whole, either = "abs(force) < 2.0", "held or not near"
    assert {(mutant.old, mutant.new) for mutant in mutants(tmp_path, "guard.py")} == {
        ("2.0", "(4.0)"),
        (whole, "(abs(force) <= 2.0)"),
        (whole, "(abs(force) > 2.0)"),
        (whole, "(not abs(force) < 2.0)"),
        ("abs(force)", "(force)"),
        (f"return {either}", "return None"),
        (either, "(held and (not near))"),
        (either, "(held)"),
        (either, "(not near)"),
        ("not near", "(near)"),
        ('raise ValueError(f"{force + 1}")', "pass"),
    }


@pytest.mark.slow
def test_a_larger_draw_holds_the_smaller_one_and_every_mutant_is_a_program() -> None:
    few, many = drawn(80, 1), drawn(160, 1)
    assert {mutant.name for mutant in few} < {mutant.name for mutant in many}
    assert all(any(mutant.file.startswith(room) for mutant in few) for room in ROOMS)
    for mutant in many:
        text = (ROOT / mutant.file).read_text("utf-8")
        assert ast.dump(ast.parse(mutant.apply_to(text))) != ast.dump(ast.parse(text))


def test_the_tests_of_a_module_judge_its_mutants() -> None:
    assert "tests/cell/orchestrator/test_monitors.py" in judges(
        "cell.orchestrator.monitors"
    )
