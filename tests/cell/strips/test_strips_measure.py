"""Bending lengths from rendered photographs of known strips, and from real ones."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from cell.strips.bending import pool
from cell.strips.cantilever_fit import RestCurvature
from cell.strips.measurement import Measurement, measure
from cell.strips.photograph import read_photograph, read_photographs
from tests.support.hanging_photographs import Scene, photograph

YARN = Path(__file__).parents[4] / "shared" / "data" / "yarn"
PHOTOGRAPHS = sorted(YARN.glob("*.jpg"))
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
        (0.010, 0.15, 0.0, 0.0),
        (0.015, 0.25, 0.0, 0.0),
        (0.020, 0.10, 0.01, 0.001),
        (0.020, 0.20, -0.01, 0.002),
        (0.030, 0.15, 0.01, -0.008),
        (0.045, 0.10, 0.0, 0.0),
        (0.060, 0.10, -0.01, 0.002),
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


def test_several_photographs_are_fitted_together_and_narrow_the_interval(tmp_path: Path) -> None:
    scenes = [Scene(overhang, 0.02, 0.002, HEIGHT) for overhang in (0.05, 0.08, 0.12)]
    alone = measured(tmp_path, scenes[:1]).bending_length
    together = measured(tmp_path, scenes)
    pooled = together.bending_length
    assert pooled.value == pytest.approx(0.02, rel=0.02)
    assert pooled.high - pooled.low < 0.7 * (alone.high - alone.low)
    assert [overhang for overhang, _ in together.bending.by_overhang] == [0.05, 0.08, 0.12]
    assert "agree within their own errors" in together.text()
    assert together.warnings == ()


@pytest.mark.parametrize("curl", [-6.0, 6.0])
def test_curl_is_named_and_does_not_spoil_the_bending_length(tmp_path: Path, curl: float) -> None:
    found = measured(tmp_path, [Scene(0.1, 0.025, 0.002, HEIGHT, curl=curl)])
    assert found.bending.prior.kind is RestCurvature.CURLED
    assert found.bending.curl.low < curl < found.bending.curl.high
    assert found.bending_length.value == pytest.approx(0.025, rel=0.03)
    straight = found.bending.straight[0].bending_length
    assert abs(straight / 0.025 - 1) > 0.04
    (warning,) = found.warnings
    assert warning.startswith("pre_curl")
    assert f"{1e3 * straight:.1f} mm" in warning


def test_s_shaped_set_is_named_and_the_interval_holds_the_truth(tmp_path: Path) -> None:
    scenes = [Scene(0.15, 0.025, 0.003, HEIGHT, set_amplitude=20.0)]
    found = measured(tmp_path, scenes)
    pooled = found.bending_length
    assert found.bending.prior.kind is RestCurvature.SET
    assert found.warnings[0].startswith("pre_curl")
    assert pooled.low < 0.025 < pooled.high
    assert found.bending.fits[0].rms < 0.2 * found.bending.straight[0].rms


def test_dark_strip_before_a_bright_wall_is_measured_as_well(tmp_path: Path) -> None:
    scene = Scene(0.08, 0.02, 0.002, HEIGHT)
    path = tmp_path / "dark.png"
    cv2.imwrite(str(path), 255 - photograph(scene, 5))
    found = measure("sample", [read_photograph(path, scene.overhang)])
    assert found.bending_length.value == pytest.approx(0.02, rel=0.03)


def test_overhangs_given_to_the_wrong_photographs_are_noticed(tmp_path: Path) -> None:
    paths = []
    for overhang in (0.06, 0.12):
        paths.append(tmp_path / f"{overhang}.png")
        cv2.imwrite(str(paths[-1]), photograph(Scene(overhang, 0.02, 0.002, HEIGHT), 1))
    found = measure("sample", read_photographs(paths, [0.12, 0.06]))
    assert any("is each --overhang that of its --photo" in each for each in found.warnings)


def test_bend_that_is_too_sharp_to_be_measured_is_reported(tmp_path: Path) -> None:
    found = measured(tmp_path, [Scene(0.25, 0.010, 0.003, HEIGHT)])
    assert any("bends too sharply at the ledge" in each for each in found.warnings)


def test_line_for_programs_agrees_with_the_text(tmp_path: Path) -> None:
    found = measured(tmp_path, [Scene(0.08, 0.02, 0.002, HEIGHT)])
    line = found.line()
    assert set(line["bending_length"]) == {"value", "low", "high"}
    assert line["bending_length"]["value"] == found.bending_length.value
    assert line["born"] == "straight"
    assert line["photographs"][0]["overhang"] == 0.08
    assert f"{1e3 * found.bending_length.value:.1f} mm" in found.text()


def test_pooled_measurements_that_agree_weigh_by_their_own_errors() -> None:
    pooled = pool([1.0, 1.1], [0.1, 0.2])
    assert pooled.value == pytest.approx(1.02)
    assert pooled.scatter == 0.0
    assert pooled.high - pooled.value > 1.95 / np.sqrt(125)


def test_pooled_measurements_that_disagree_widen_the_interval() -> None:
    pooled = pool([1.0, 2.0, 3.0], [0.01, 0.01, 0.01])
    assert pooled.agreement < 1e-6
    assert pooled.scatter == pytest.approx(1.0, rel=1e-3)
    assert pooled.high - pooled.low > 4.0


@pytest.mark.slow
@pytest.mark.skipif(not PHOTOGRAPHS, reason="the photographs of yarn are not beside the checkout")
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
