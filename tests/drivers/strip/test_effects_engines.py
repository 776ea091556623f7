"""Rod and chain, which share no code, agree on every effect that both have."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from drivers.base.readers import read_yaml
from drivers.base.types import Array
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Stage
from drivers.strip.engine import StripMotion
from drivers.strip.rod.engine import Rod
from drivers.twin.chain.engine import Chain
from tests.support.effect_cases import affected, bare, fold, levels
from tests.support.seen_folds import distances

SEGMENTS, LINKS = 150, 100
# s: the first pull on a straight strip, and the snap, are chaotic
SETTLED, FALLING = 1.5, 0.15
Values = Mapping[str, float]

# Engines are driven by true poses over the true desk: these come before them or after
# them.
OUTSIDE = {"desk_height", "tcp_offset", "gripper_tilt", "control_delay"}
VALUES: dict[str, list[Values]] = read_yaml(
    Path(__file__).with_name("effect_values.yaml")
)
UNSEEN = {"pre_curl", "layer_adhesion"}  # between clamped ends; before the touch
SIMULATED = {e.name: e for e in registry().values() if e.stage is not Stage.OBSERVATION}


def values_of(name: str) -> list[Values]:
    """Values to compare engines at; the middle level of each parameter where none are
    chosen.
    """
    return VALUES.get(name) or levels(SIMULATED[name])[1::3]


@lru_cache
def plain(path: str) -> StripMotion:
    return fold(Chain(LINKS), bare(), path)


def apart(rod: StripMotion, chain: StripMotion) -> Array:
    """Distances [m] of the chain's links from the rod, from the lift up to the snap."""
    end = min(rod.t[-1], chain.t[-1]) - FALLING
    found = []
    for t in np.arange(SETTLED, end, 0.2):
        curve = rod.shapes[np.argmin(np.abs(rod.t - t))]
        nodes = chain.shapes[np.argmin(np.abs(chain.t - t))]
        found.append(distances(0.5 * (nodes[1:] + nodes[:-1]), curve))
    return np.concatenate(found)


CASES = [
    (name, v) for name in sorted(SIMULATED.keys() - OUTSIDE) for v in values_of(name)
]
QUICK = {"bending_hysteresis": 1, "stretch": 1} | dict.fromkeys(
    ("relaxation", "air_drag", "length_error", "end_slip"), 0
)  # by the number of the value


@pytest.mark.parametrize(
    ("name", "values", "path"),
    [
        *((name, VALUES[name][number], "triangular") for name, number in QUICK.items()),
        *(
            pytest.param(name, values, path, marks=pytest.mark.long)
            for name, values in CASES
            for path in ("triangular", "circular")
        ),
    ],
)
def test_engines_agree_on_an_effect(name: str, values: Values, path: str) -> None:
    model = affected(name, **values)
    rod, chain = (fold(engine, model, path) for engine in (Rod(SEGMENTS), Chain(LINKS)))
    assert chain.touch.displacement == pytest.approx(rod.touch.displacement, abs=0.002)
    assert np.sqrt((apart(rod, chain) ** 2).mean()) < 0.001
    size = min(len(chain.contact_x), len(plain(path).contact_x))
    shown = np.abs(chain.contact_x[:size] - plain(path).contact_x[:size]).max()
    assert shown > 1e-5 or name in UNSEEN


@pytest.mark.long
@pytest.mark.parametrize("name", VALUES)
def test_chain_stays_finite_over_the_range_of_every_parameter(name: str) -> None:
    for values in levels(registry()[name]):
        motion = fold(Chain(60), affected(name, **values), "triangular")
        assert np.isfinite(motion.contact_x).all(), values
        assert motion.touch is not None, values
