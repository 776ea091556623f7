"""Effects in the chain do what their laws say, alone."""

import numpy as np
import pytest

from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.file import paper_damping_minimum, paper_strip
from drivers.twin.chain.engine import Chain
from policies.path import triangular
from tests.support.chain_moves import H, displacement
from tests.support.effect_cases import PATHS, affected, denim, fold, simulate

LINKS = 40


@pytest.mark.parametrize(
    ("yield_curvature", "path", "expected"),
    [
        (3.0, "triangular", -0.0381),
        (12.0, "triangular", -0.0462),
        (12.0, "circular", 0.0693),
    ],
)
def test_yarn_friction_costs_no_small_steps(
    yield_curvature: float, path: str, expected: float
) -> None:
    """Expected: the rod at 1 ms. Taken as a spring, yarns were 4 to 7 mm off at 5
    ms.
    """
    effects = {"bending_hysteresis": {"yield_curvature": yield_curvature}}
    model = describe(paper_strip(0.1, 3 * paper_damping_minimum(0.1), effects=effects))
    t = np.arange(0.0, PATHS[path].length / 0.1, H)
    motion = simulate(Chain(80), model, t, PATHS[path].poses(t * 0.1))
    assert displacement(motion) == pytest.approx(expected, abs=0.002)


def test_lightest_strip_in_the_thickest_air_stays_stable() -> None:
    light = denim(areal_density=0.02, effects={"air_drag": {"coefficient": 10.0}})
    assert np.isfinite(
        fold(Chain(LINKS), describe(light), "triangular").contact_x
    ).all()


def test_layers_that_cling_part_later() -> None:
    together = []
    for force in (0.0, 25.0):
        chain = Chain(LINKS)
        strip = paper_strip(0.1, 0.002, length=0.4)
        chain.reset([affected("layer_adhesion", strip, force=force)])
        path = triangular(0.4)
        way = iter(path.poses(np.minimum(np.arange(H, 9.0, H) * 0.1, path.length)))
        while chain.step((pose := next(way))[None], H).touch[0] is None:
            pass
        for _ in range(200):
            pose = next(way)
            chain.step(pose[None], H)
        for _ in range(100):
            pose[1] += 0.0005
            chain.step(pose[None], H)
        together.append(layers_together(chain.shapes()[0], 0.0016))
    assert together[1] > together[0] + 2


def layers_together(shape: Array, gap: float) -> int:
    """Nodes of the upper layer that stand within `gap` [m] of the lower one."""
    tip = int(np.argmax(shape[:, 0]))
    lower = np.interp(shape[tip:, 0], shape[: tip + 1, 0], shape[: tip + 1, 1])
    return int((shape[tip:, 1] - lower < gap)[3:].sum())
