"""YAML is read within bounds, its numbers in every notation; an edit keeps what people
wrote.
"""

from pathlib import Path

import pytest
import yaml

from cell.base.config.places import CHECKOUT_CONFIGS
from drivers.base.yaml_text import edit_yaml, parse_yaml
from tests.support.refusals import refusal

COMMENTED = """\
# The strip of the second shelf.
schema: 1
name: felt            # as on the label
thickness: 0.0010     # calipers, three places
length: 0.50
colour: [40, 60, 110]
effects:
  seam: {factor: 1.5, position: 0.25, width: 0.02}  # by eye
provenance:
  # what was weighed
  - key: areal_density
    source: >-
      balance, ten
      pieces
  - key: thickness
    source: 'calipers'
"""


def test_what_does_not_change_stays_as_it_is_written() -> None:
    content = yaml.safe_load(COMMENTED)
    new = edit_yaml(COMMENTED, content | {"thickness": 0.0012, "bending_length": 0.021})
    assert new.splitlines()[:3] == COMMENTED.splitlines()[:3]
    assert "thickness: 0.0012     # calipers, three places" in new
    assert new.splitlines()[4:-1] == COMMENTED.splitlines()[4:]
    assert new.splitlines()[-1] == "bending_length: 0.021"


def test_number_of_more_digits_than_any_value_has_is_refused() -> None:
    with refusal("line 1: is a number of 65 digits, at most 64"):
        parse_yaml(f"length: {10**64}", "felt.yaml")


def test_an_entry_put_before_others_leaves_them() -> None:
    content = yaml.safe_load(COMMENTED)
    measured = {"key": "length", "source": "ruler"}
    new = edit_yaml(
        COMMENTED, content | {"provenance": [measured, *content["provenance"]]}
    )
    assert yaml.safe_load(new)["provenance"][0] == measured
    assert "source: 'calipers'" in new
    assert "      balance, ten\n      pieces" in new
    assert "# what was weighed" in new
    assert "# by eye" in new


@pytest.mark.parametrize(
    "path", sorted((CHECKOUT_CONFIGS / "strips").glob("*.yaml")), ids=lambda p: p.stem
)
def test_files_of_the_cell_are_written_as_they_are(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    changed = edit_yaml(text, yaml.safe_load(text) | {"bending_length": 0.02})
    other = [
        a
        for a, b in zip(text.splitlines(), changed.splitlines(), strict=True)
        if a != b
    ]
    assert [line.partition(":")[0] for line in other] == ["bending_length"]


def test_cell_file_keeps_its_comments_beside_a_new_effect() -> None:
    text = (CHECKOUT_CONFIGS / "cell.yaml").read_text(encoding="utf-8")
    new = edit_yaml(
        text, yaml.safe_load(text) | {"effects": {"desk_tilt": {"angle": 0.004}}}
    )
    assert {*text.splitlines()} - {*new.splitlines()} == {"effects: {}"}
    assert yaml.safe_load(new)["effects"] == {"desk_tilt": {"angle": 0.004}}
