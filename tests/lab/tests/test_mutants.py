"""The list of bugs put in by hand still fits the code that it is about."""

import ast

import pytest
import yaml

from tests.lab.mutants import ROOT, Mutant, Unusable, listed

MUTANTS = listed()


@pytest.mark.parametrize(
    "mutant", MUTANTS, ids=lambda mutant: mutant.name.replace(" ", "-")
)
def test_mutant_applies_once_and_is_still_a_program(mutant: Mutant) -> None:
    text = (ROOT / mutant.file).read_text("utf-8")
    assert mutant.old != mutant.new
    read = ast.parse if mutant.file.endswith(".py") else yaml.safe_load
    read(mutant.apply_to(text))
    assert mutant.tests
    assert all((ROOT / test.partition("::")[0]).is_file() for test in mutant.tests)


def test_mutant_whose_text_is_gone_is_an_error() -> None:
    gone = Mutant("gone", "README.md", "a text that stands nowhere", "", ())
    with pytest.raises(Unusable, match="0 times"):
        gone.apply_to("another text")
