"""Features of a fold whose contact, tip and gap are known, and the rod's touches."""

import math

import numpy as np
import pytest

from drivers.strip.rod.engine import Rod
from drivers.strip.shape import NO_GAP, desk_contact, fold_tip, layer_gap, layer_touch
from policies.path import circular, triangular
from tests.support.rod_cases import for_all, paper_grid, steady

DT, HEIGHT, OPENING = 0.005, 0.001, 0.002  # s, m, m
# m: of a bend, before it, after it, there
RADIUS, LYING, BACK, SAG = 0.02, 0.3, 0.2, 0.025
TURN, BEHIND = np.linspace(0, np.pi, 400)[1:], np.linspace(0, BACK, 401)[1:]
FOLD = np.array(
    [
        *((x, 0.0) for x in np.linspace(0, LYING, 300)),
        *zip(LYING + RADIUS * np.sin(TURN), RADIUS * (1 - np.cos(TURN)), strict=True),
        *(
            (LYING - s, 2 * RADIUS - SAG * math.sin(math.pi * s / BACK) ** 2)
            for s in BEHIND
        ),
    ]
)
ARC = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(FOLD, axis=0).T))])


def test_features_of_a_fold_are_those_of_its_curve() -> None:
    rise = LYING + math.sqrt(RADIUS**2 - (RADIUS - HEIGHT) ** 2)
    assert desk_contact(FOLD, HEIGHT) == pytest.approx(rise, abs=1e-6)
    assert fold_tip(FOLD) == pytest.approx((LYING + RADIUS, RADIUS), abs=1e-6)
    middle = (LYING + np.pi * RADIUS + ARC[-1]) / 2
    expected = (2 * RADIUS - SAG, LYING - BACK / 2, middle)
    assert layer_gap(FOLD, ARC, OPENING) == pytest.approx(expected, abs=2e-5)
    assert layer_gap(FOLD, ARC, 2 * RADIUS) is None  # it never opens so far
    assert layer_gap(FOLD[:500], ARC[:500], OPENING) is None


def test_hump_before_the_fold_is_no_contact_and_a_lying_strip_has_its_at_the_end():
    humped = FOLD.copy()
    humped[20:60, 1] = 0.005
    assert desk_contact(humped, HEIGHT) == desk_contact(FOLD, HEIGHT)
    assert desk_contact(FOLD[:300], HEIGHT) == LYING


@pytest.mark.parametrize(
    "path", [triangular(0.6), triangular(0.6, 0.045), circular(0.6)]
)
def test_touches_of_the_rod_are_where_the_gap_of_its_shapes_fell_to_the_limit(
    path,
) -> None:
    rod, models = Rod(60), paper_grid()[::3]
    rod.reset(models)
    shapes = rod.trace(for_all(steady(path, DT), len(models)), DT, every=1).shapes
    for i, touch in enumerate(rod.touch):
        last = math.ceil(touch.time / DT)
        before, now = (
            layer_gap(shapes[k - 1, i], rod.arc()[i], OPENING) or NO_GAP
            for k in (last - 1, last)
        )
        assert now.height <= 0.001 < before.height
        share, x, s = layer_touch(tuple(before), tuple(now), 0.001)
        gap, *place = (a + share * (b - a) for a, b in zip(before, now, strict=True))
        assert (gap, *place) == pytest.approx((0.001, x, s), abs=1e-12)
        assert touch.time == pytest.approx((last - 1 + share) * DT, abs=1e-9)
        assert touch.displacement == pytest.approx(0.6 - s - x, abs=1e-9)
