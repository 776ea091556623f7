"""Effects of bending: the law of the moment, its change along the strip, and rest
curvature.
"""

from collections.abc import Mapping

import numpy as np

from drivers.base.types import GRAVITY
from drivers.strip.effects.effect import (
    PLACE_SPAN,
    POSITION,
    WIDTH,
    Parameter,
    Span,
    law_effect,
    set_fields,
)
from drivers.strip.model import SOFTEST, StripModel, scale_rigidity, with_added

HALF_WIDTH = 0.005  # m to each side over which a crease turns
# bending lengths from the grip to where its first turn bends a lying strip
GRASP_BEND = 1.2


def _add_crease(model: StripModel, angle: float, position: float) -> StripModel:
    """Copy of `model` with a crease: a rest angle `angle` [rad] at arc length
    `position` [m].
    """
    mechanics = model.mechanics
    away = np.abs(mechanics.cells - position)
    near = mechanics.inside(position, 2 * HALF_WIDTH) * np.clip(
        1.0 - away / HALF_WIDTH, 0.0, 1.0
    )
    curvature = angle * near / mechanics.total(near, mechanics.ends)
    return with_added(model, "mechanics.rest_curvature", curvature)


def _add_grasp_crease(model: StripModel, turn: float) -> StripModel:
    """Copy of `model` with a crease of `turn` [rad] in front of the gripper, as the
    grasp leaves it.

    The grasp turns and pushes the lying strip before it is lifted. Where it bends then
    depends on unknown slack, and the crease left in a strip with bending hysteresis
    depends on its history; so the crease is a parameter.
    """
    if not turn:
        return model
    mechanics = model.mechanics
    weight = float(np.mean(mechanics.linear_density)) * GRAVITY
    bending_length = (float(np.mean(mechanics.rigidity)) / weight) ** (1 / 3)
    return _add_crease(model, -turn, mechanics.length - GRASP_BEND * bending_length)


def _age(model: StripModel, values: Mapping[str, float]) -> StripModel:
    return scale_rigidity(model, max(SOFTEST, 1.0 - values["rate"] * model.index))


AGEING = law_effect(
    name="ageing",
    sentence="the strip grows softer from run to run",
    parameters=(Parameter.signed("rate", "1", 0.5),),
    apply=_age,
    typical=lambda _: (0.003, 0.03),
    revealed_by=(
        "the first run of a series repeated as the last, and runs in shuffled order"
    ),
)


_set_friction = set_fields(
    yield_curvature="mechanics.law.yield_curvature",
    stiffness_ratio="mechanics.law.stiffness_ratio",
    gradual="mechanics.law.gradual",
)

BENDING_HYSTERESIS = law_effect(
    name="bending_hysteresis",
    sentence="yarn friction resists the bending of the strip",
    parameters=(
        Parameter("yield_curvature", "1/m", low=0.0, high=100.0),
        Parameter(
            name="stiffness_ratio",
            unit="1",
            start=8.0,
            low=1.0,
            high=100.0,
            step=0.16,
            spread=4.0,
            role="ratio",
        ),
        Parameter.shape("set", "rad", high=3.0, guess=0.3),
        Parameter.shape("gradual", "1", high=1.0, guess=0.3),
    ),
    apply=lambda model, values: _add_grasp_crease(
        _set_friction(model, values), values["set"]
    ),
    typical=lambda _: (1.0, 5.0, 20.0),
    textile={
        "yield_curvature": Span(2.0, 60.0, log=True),  # KES tables hold 20 to 60
        "stiffness_ratio": Span(5.0, 12.0),
    },
    revealed_by=(
        "a slow fold there and back: the shapes on the two ways differ at the same"
        " place"
    ),
)

CREASE = law_effect(
    name="crease",
    sentence="the strip has a crease",
    parameters=(
        Parameter.signed("angle", "rad", 2.0),
        POSITION,
    ),
    apply=lambda model, values: _add_crease(model, values["angle"], values["position"]),
    typical=lambda _: (-0.3, 0.3),
    textile={"angle": Span(-0.3, 0.3), "position": PLACE_SPAN},
    revealed_by="slow folds of other heights: a bend stays at one place of the strip",
)

NONLINEAR_BENDING = law_effect(
    name="nonlinear_bending",
    sentence="the strip grows stiffer (or softer) the more sharply it is bent",
    # Below -5e-6 the moment would fall again at curvatures that a fold reaches (258
    # 1/m).
    parameters=(
        Parameter("cubic", "m^2", low=-5e-6, high=1e-3),
        Parameter.shape("fifth", "1", high=10.0, guess=0.3),
    ),
    apply=set_fields(cubic="mechanics.law.cubic", fifth="mechanics.law.fifth"),
    typical=lambda _: (-4e-6, 3e-5, 2e-4),
    textile={"cubic": Span(3e-5, 2e-4, log=True)},
    revealed_by="a slow fold with a low and a high carry: only sharp bends change",
)


PRE_CURL = law_effect(
    name="pre_curl",
    sentence="the strip curls by itself",
    parameters=(Parameter.signed("curvature", "1/m", 60.0),),
    apply=lambda model, values: with_added(
        model, "mechanics.rest_curvature", values["curvature"]
    ),
    typical=lambda _: (0.5, 5.0),
    textile={"curvature": Span(-5.0, 5.0)},
    revealed_by="a strip that hangs free; while both edges are clamped it shows little",
)

QUADRATIC_DAMPING = law_effect(
    name="quadratic_damping",
    sentence="the strip resists quick bending more than in proportion",
    parameters=(Parameter("coefficient", "m s^2", low=0.0, high=0.02),),
    apply=set_fields(coefficient="mechanics.law.quadratic_damping"),
    typical=lambda _: (1e-4, 1e-3),
    textile={"coefficient": Span(1e-4, 1e-3, log=True)},
    revealed_by=(
        "a fast fold against a slow one, and a shake: only quick bending changes"
    ),
)

_set_relaxation = set_fields(
    ratio="mechanics.law.relaxing", time="mechanics.law.relaxation_time"
)

RELAXATION = law_effect(
    name="relaxation",
    sentence="the strip slowly gives way while it is held bent",
    parameters=(
        Parameter("ratio", "1", low=0.0, high=0.9),
        Parameter.scale("time", "s", low=0.01, high=100.0, role="time"),
        Parameter.shape("set", "rad", high=3.0, guess=0.3),
    ),
    apply=lambda model, values: _add_grasp_crease(
        _set_relaxation(model, values), values["set"]
    ),
    typical=lambda _: (0.03, 0.2),
    textile={"ratio": Span(0.03, 0.2), "time": Span(0.1, 2.0, log=True)},
    revealed_by="a fold that stops and holds: the shape goes on sagging",
)


def _stiffen_seam(model: StripModel, values: Mapping[str, float]) -> StripModel:
    covered = model.mechanics.inside(
        values["position"], values["width"], values["softness"]
    )
    return scale_rigidity(model, (1.0 - covered) + covered * values["factor"])


SEAM = law_effect(
    name="seam",
    sentence="the strip has a seam, a piece of other stiffness",
    parameters=(
        Parameter("factor", "1", start=1.0, low=0.1, high=50.0),
        POSITION,
        WIDTH,
        Parameter.shape("softness", "1", high=2.0, guess=0.4),
    ),
    apply=_stiffen_seam,
    typical=lambda _: (1.8,),
    textile={
        "position": PLACE_SPAN,
        "factor": Span(1.5, 5.0),
        "width": Span(0.01, 0.01),
    },
    revealed_by=(
        "slow folds of other heights: the shape changes where the seam passes the bend"
    ),
)


def _stiffen_towards_one_end(
    model: StripModel, values: Mapping[str, float]
) -> StripModel:
    """Copy of `model` whose bending rigidity rises linearly along the strip, or with
    `central` more steeply in the middle.
    """
    away = model.mechanics.positions
    rise = away * (1.0 + values["central"] * (1.0 - 4.0 * away**2))
    return scale_rigidity(model, 1.0 + values["slope"] * rise)


STIFFNESS_GRADIENT = law_effect(
    name="stiffness_gradient",
    sentence="the strip is stiffer towards one of its ends",
    parameters=(
        Parameter.signed("slope", "1", 1.8),
        Parameter.shape("central", "1", high=1.0, guess=0.3),
    ),
    apply=_stiffen_towards_one_end,
    typical=lambda _: (0.2, 0.8),
    textile={"slope": Span(-0.8, 0.8)},
    revealed_by="the strip with its ends swapped, and folds of other heights",
)
