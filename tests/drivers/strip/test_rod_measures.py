"""What the rod's compiled code measures is what `drivers.strip.shape` defines."""

import math

import numba
import numpy as np
import pytest

from drivers.strip import shape as definition
from drivers.strip.rod import measures as compiled
from drivers.strip.rod.engine import Rod
from drivers.types import Array
from policies.path import Path, circular, triangular
from tests.support.rod_cases import for_all, paper_grid, steady

DT = 0.005
OPENING = 0.002  # m
PATHS = {
    "triangular": triangular(0.6),
    "shifted": triangular(0.6, 0.045),
    "circular": circular(0.6),
}


@numba.njit
def _measured(x: Array, z: Array, height: float, opening: float) -> tuple[float, ...]:
    tip = compiled.rightmost(x)
    contact = compiled.desk_contact(x, z, tip, height)
    tip_x, tip_z = compiled.fold_tip(x, z, tip)
    gap, index = compiled.layer_gap(x, z, tip, opening)
    return contact, tip_x, tip_z, gap, compiled.along(x, index), index


def _agree(points: Array) -> bool:
    """Whether compiled code and definition agree on a shape; whether it has a gap."""
    x, z = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1])
    contact, tip_x, tip_z, height, gap_x, index = _measured(x, z, 0.001, OPENING)
    assert contact == definition.desk_contact(points, 0.001)
    assert (tip_x, tip_z) == definition.fold_tip(points)
    gap = definition.layer_gap(points, np.arange(len(points), dtype=np.float64), OPENING)
    if gap is None:
        assert math.isinf(height)
        return False
    assert (height, gap_x, index) == pytest.approx((gap.height, gap.x, gap.s), abs=1e-12)
    return True


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_measures_of_folds_are_as_defined(path: Path) -> None:
    rod = Rod(60)
    rod.reset(paper_grid()[::3])
    seen = rod.follow(for_all(steady(path, DT), 9), DT, every=20)
    shapes = [s for many in seen.shapes for s in many if np.isfinite(s).all()]
    assert sum(_agree(shape) for shape in shapes) > 20


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_touches_are_as_defined(path: Path) -> None:
    rod = Rod(60)
    models = paper_grid()[::3]
    rod.reset(models)
    shapes = rod.follow(for_all(steady(path, DT), len(models)), DT, every=1).shapes
    for i, touch in enumerate(rod.touch):
        assert touch is not None
        last = math.ceil(touch.time / DT)
        gaps = [
            (k * DT, definition.layer_gap(shapes[k - 1, i], rod.arc()[i], OPENING))
            for k in (last - 1, last)
        ]
        defined = definition.touch_between(gaps[0], gaps[1], 0.001, 0.6)
        assert defined is not None
        assert touch.time == pytest.approx(defined.time, abs=1e-9)
        assert touch.displacement == pytest.approx(defined.displacement, abs=1e-9)
