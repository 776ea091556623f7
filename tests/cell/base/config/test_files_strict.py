"""Files that a person writes: what is wrong with them is one line, whatever it is."""

from pathlib import Path

import pytest

from drivers.base.errors import ConfigurationError
from drivers.strip.describe import load_strip
from drivers.strip.file import StripFile
from tests.support.refusals import refusal

TEXT = """\
schema: 1
name: felt
length: 0.6
width: 0.05
areal_density: 0.4
bending_length: 0.017
retardation_time: 0.03
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "felt.yaml"


def load(path: Path, text: str) -> StripFile:
    path.write_text(text, encoding="utf-8")
    return load_strip(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("length: 0.6", 'length: "0.6"'),
        ("length: 0.6", "length: true"),
        ("length: 0.6", "length: [0.6]"),
        ("length: 0.6", "length: 1e999"),
        ("length: 0.6", "length: -.inf"),
        ("length: 0.6", "length:"),
        ("width: 0.05", "width: 1e-210"),
        ("areal_density: 0.4", "areal_density: 1e-210"),
        ("schema: 1", "schema: 1\nthickness: 1e-210"),
        ("name: felt", "name: 5"),
        ("name: felt", "name: yes"),
        ("name: felt", "name: ../felt"),
        ("schema: 1", 'schema: "1"'),
        ("schema: 1", "schema: 2"),
        ("schema: 1", "schema: 1\ncolour: [1.5, 2, 3]"),
        ("schema: 1", "schema: 1\ncolour: [true, 2, 3]"),
        ("schema: 1", "schema: 1\ncolour: [1, 2]"),
        ("schema: 1", "schema: 1\neffects: {nonlinear_bending: {cubic: yes}}"),
        ("schema: 1", "schema: 1\neffects: {nonlinear_bending: {cubic: .nan}}"),
        ("schema: 1", "schema: 1\n7: seven"),
    ],
)
def test_no_value_is_converted_to_another_type(path: Path, old: str, new: str) -> None:
    assert old in TEXT
    with pytest.raises(ConfigurationError) as refused:
        load(path, TEXT.replace(old, new))
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value).replace(f"\n{path}: ", "")


def test_numbers_may_be_written_as_people_write_them(path: Path) -> None:
    strip = load(path, TEXT.replace("length: 0.6", "length: 1").replace("0.03", "3e-2"))
    assert (strip.length, strip.retardation_time) == (1.0, 0.03)


def test_an_unknown_key_is_answered_with_the_known_ones_as_files_spell_them(
    path: Path,
) -> None:
    with refusal(r"allowed here: .*\bschema\b,"):
        load(path, TEXT + "colur: [1, 2, 3]\n")
