"""Names that somebody misspells: answered at once, with the name that was meant."""

from pathlib import Path

import pytest

from drivers.base.errors import ConfigurationError, suggestion
from drivers.base.readers import read_yaml
from drivers.base.settings import parse
from drivers.strip.describe import load_strip
from drivers.strip.file import StripFile
from policies.registry import make_policy
from tests.support.refusals import refusal

ROOT = Path(__file__).resolve().parents[4]
DENIM = ROOT / "configs" / "strips" / "denim.yaml"
CONTENT = read_yaml(DENIM)


def test_misspelt_keys_and_policies_name_what_was_meant(tmp_path: Path) -> None:
    with refusal(r"lenght: unknown key \(did you mean 'length'\?"):
        parse(CONTENT | {"lenght": 0.6}, StripFile, "a.yaml")
    path = tmp_path / "a.yaml"
    path.write_text(f"{DENIM.read_text()}effects: {{seem: {{}}}}\n")
    with refusal(r"did you mean 'seam'\?"):
        load_strip(path)
    path.write_text(f"{DENIM.read_text()}effects: {{seam: {{factr: 1.0}}}}\n")
    with refusal(r"did you mean 'factor'\?"):
        load_strip(path)
    with refusal(r"did you mean 'circular'\?"):
        make_policy("circlar")


@pytest.mark.parametrize(
    ("typed", "known", "meant"),
    [
        ("gpa", ["gpu", "gap"], "gap"),
        ("fliter", ["flitter", "filter", "fitter"], "filter"),
        ("sm", ["m", "mm", "ms", "s"], "ms"),
        ("lenght", ["length", "lens"], "length"),
    ],
)
def test_swapped_letters_are_one_error_of_typing(typed, known, meant) -> None:
    assert suggestion(typed, known) == f" (did you mean {meant!r}?)"


def test_what_is_far_from_every_name_has_no_suggestion() -> None:
    assert suggestion("qqq", ["gap", "fold"]) == suggestion("x", []) == ""


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("length", 600.0, "is 600 m, must be at least 0.1 m and at most 2 m; "
                          "if 600 is in mm, write 0.6"),
        ("areal_density", 400.0, "if 400 is in g/m^2, write 0.4"),
        ("retardation_time", 30.0, "if 30 is in ms, write 0.03"),
        ("retardation_time", -1.0, "is -1 s, must be at least 0 s and at most 10 s"),
        ("colour", [0, 0, 300], "colour.2: is 300, must be at most 255"),
    ],
)  # fmt: skip
def test_number_out_of_range_is_given_with_its_unit(key, value, said) -> None:
    with pytest.raises(ConfigurationError) as error:
        parse(CONTENT | {key: value}, StripFile, "a.yaml")
    assert said in str(error.value)
