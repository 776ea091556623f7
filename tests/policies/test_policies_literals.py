"""What was fitted to folds stands in data files with its origin, and nowhere in the
source.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
KNOWN = {1.25, 1.96}  # a direction over pi, and the sigmas of 95 %


def fitted_literals(source: str) -> list[str]:
    """Numbers of three digits and more in `source`: a person rounds what he chooses to
    two.
    """
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, float):
            written = ast.get_source_segment(source, node) or ""
            digits = (
                written.lower()
                .partition("e")[0]
                .replace(".", "")
                .replace("_", "")
                .strip("0")
            )
            if len(digits) >= 3 and node.value not in KNOWN:
                found.append(written)
    return found


@pytest.mark.parametrize(
    "room",
    [
        "policies",
        "cell/folding",
        "cell/perception/laid_fold.py",
        "cell/perception/model_agreement.py",
    ],
)
def test_no_fitted_number_stands_in_the_source(room: str) -> None:
    place = ROOT / room
    modules = sorted(place.rglob("*.py")) if place.is_dir() else [place]
    assert modules
    assert not {
        m.name: found
        for m in modules
        if (found := fitted_literals(m.read_text("utf-8")))
    }


def test_a_typed_in_fit_is_found() -> None:
    assert fitted_literals("BIAS = (0.615, -1.05e-3, 0.5)") == ["0.615", "1.05e-3"]
