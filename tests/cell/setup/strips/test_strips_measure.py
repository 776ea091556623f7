"""Bending lengths from rendered photographs of known strips, and from real ones."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from cell.setup.strips.cantilever_fit import RestCurvature
from cell.setup.strips.fit_figure import _zoom_to_ledge
from cell.setup.strips.measurement import Measurement, _overhang_warning, measure
from cell.setup.strips.photograph import read_photograph, read_photographs
from tests.support.hanging_photographs import Scene, photograph
from tests.support.shared import PHOTOGRAPHS, YARN, needs

HEIGHT = 1000


def measured(folder: Path, scenes: Sequence[Scene], seed: int = 0) -> Measurement:
    photographs = []
    for index, scene in enumerate(scenes):
        path = folder / f"hanging-{index}.png"
        cv2.imwrite(str(path), photograph(scene, seed + index))
        photographs.append(read_photograph(path, scene.overhang))
    return measure("sample", photographs)


@pytest.mark.parametrize(
    ("bending_length", "overhang", "roll", "cropped"),
    [
        (0.010, 0.05, 0.0, 0.0),
        (0.015, 0.25, 0.0, 0.0),
        (0.020, 0.20, -0.01, 0.002),
        (0.060, 0.25, 0.01, 0.002),
    ],
)
def test_rendered_hanging_gives_its_bending_length_within_five_per_cent(
    tmp_path: Path, bending_length: float, overhang: float, roll: float, cropped: float
) -> None:
    scene = Scene(overhang, bending_length, 0.002, HEIGHT, roll=roll, cropped=cropped)
    found = measured(tmp_path, [scene])
    pooled = found.bending_length
    assert pooled.value == pytest.approx(bending_length, rel=0.05)
    assert pooled.low < bending_length < pooled.high
    assert not any(each.startswith("pre_curl") for each in found.warnings)


@pytest.mark.parametrize("curl", [-6.0, 6.0])
def test_curl_is_named_and_does_not_spoil_the_bending_length(
    tmp_path: Path, curl: float
) -> None:
    found = measured(tmp_path, [Scene(0.1, 0.025, 0.002, HEIGHT, curl=curl)])
    assert found.bending.prior.kind is RestCurvature.CURLED
    assert found.bending.curl.low < curl < found.bending.curl.high
    assert found.bending_length.value == pytest.approx(0.025, rel=0.03)
    straight = found.bending.straight[0].bending_length
    assert abs(straight / 0.025 - 1) > 0.04
    (warning,) = found.warnings
    assert warning.startswith("pre_curl")
    assert f"{1e3 * straight:.1f} mm" in warning


def test_overhangs_given_to_the_wrong_photographs_are_noticed(tmp_path: Path) -> None:
    paths = []
    for overhang in (0.06, 0.12):
        paths.append(tmp_path / f"{overhang}.png")
        cv2.imwrite(str(paths[-1]), photograph(Scene(overhang, 0.02, 0.002, HEIGHT), 1))
    found = measure("sample", read_photographs(paths, [0.12, 0.06]))
    assert any(
        "is each --overhang that of its --photo" in each for each in found.warnings
    )


@pytest.mark.slow
@needs(YARN)
def test_real_yarn_has_one_bending_length_at_all_overhangs() -> None:
    overhangs = [float(path.stem.split("_")[2]) / 100 for path in PHOTOGRAPHS]
    found = measure("acrylic", read_photographs(PHOTOGRAPHS, overhangs))
    pooled = found.bending_length
    assert pooled.agreement > 0.05
    assert len(found.bending.by_overhang) == 4
    for _, each in found.bending.by_overhang:
        assert each.low < pooled.value < each.high
    assert pooled.high / pooled.low < 1.2
    assert found.warnings[0].startswith("pre_curl")
    for fit, straight in zip(found.bending.fits, found.bending.straight, strict=True):
        assert fit.rms < 0.05 * fit.photograph.width
        assert straight.rms > 3 * fit.rms


@pytest.mark.parametrize(("overhang", "hint"), [(0.01, "a: hardly bends"), (0.05, "")])
def test_a_short_overhang_that_tells_little_is_named(
    overhang: float, hint: str
) -> None:
    taken = SimpleNamespace(name="a", overhang=overhang, width=1e-4)
    fits = [SimpleNamespace(photograph=taken, sigma=0.2)]
    bending: Any = SimpleNamespace(
        bending_length=SimpleNamespace(value=0.02), fits=fits
    )
    assert _overhang_warning(bending).partition(";")[0] == hint


def test_the_figure_of_a_fit_shows_the_ledge_below_its_upper_border() -> None:
    seen: dict[str, Any] = {}
    axes = SimpleNamespace(set=seen.update, legend=lambda **_: None)
    points = np.array([[0.2, 0.3]])
    taken = SimpleNamespace(overhang=0.1, pixel=1e-3, points=points)
    _zoom_to_ledge(
        axes, cast(Any, SimpleNamespace(photograph=taken, bending_length=0.02))
    )
    low, high = sorted(seen["ylim"])
    assert low < -300 < high
