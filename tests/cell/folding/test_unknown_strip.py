"""A fabric without a file: named by its length, and offered as a file after the
fold.
"""

from pathlib import Path

import pytest

from cell.base.config.places import CHECKOUT_CONFIGS, Configs
from cell.folding.documents import LEARNED, offer_strip
from drivers.strip.describe import load_strip
from drivers.strip.file import StripFile
from policies.policy import FoldPrediction, ParameterEstimate

PREDICTED = FoldPrediction(
    displacement=-0.0004,
    sigma=0.0007,
    bending_length=ParameterEstimate(0.0219, 0.0217, 0.0220),
    retardation_time=ParameterEstimate(0.013, 0.009, 0.018),
    yield_curvature=ParameterEstimate(32.0, 25.0, 40.0),
    blind=False,
)


def without_file(length: str) -> StripFile:
    return Configs(CHECKOUT_CONFIGS).strip(f"unknown:{length}")


def test_strip_without_a_file_is_the_middle_of_the_papers_range() -> None:
    strip = without_file("0.6")
    assert strip.length == 0.6
    low, high = strip.spread["bending_length"]
    assert low < strip.bending_length < high
    assert {entry.source for entry in strip.provenance} == {"assumed"}


def test_offered_file_is_a_strip_file_that_says_where_its_numbers_are_from(
    tmp_path: Path,
) -> None:
    strip = without_file("0.6")
    path = offer_strip(tmp_path, strip, PREDICTED)
    assert path == tmp_path / LEARNED
    learned = load_strip(path)
    assert learned.bending_length == pytest.approx(0.0219)
    assert learned.spread["retardation_time"] == pytest.approx((0.009, 0.018))
    assert learned.effects["bending_hysteresis"]["yield_curvature"] == pytest.approx(
        32.0
    )
    told = {entry.key: entry.source for entry in learned.provenance}
    assert tmp_path.name in told["bending_length"]
    assert told["width"] == "assumed"
