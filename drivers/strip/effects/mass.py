"""Effects of the strip's length, mass, stretch and surface."""

from collections.abc import Mapping

from drivers.strip.effects.effect import (
    POSITION,
    WIDTH,
    Parameter,
    Span,
    Stage,
    law_effect,
    set_fields,
)
from drivers.strip.model import Drag, StripModel, with_added, with_field


def _change_length(model: StripModel, values: Mapping[str, float]) -> StripModel:
    return with_field(model, "mechanics.length", model.stated_length + values["error"])


LENGTH_ERROR = law_effect(
    name="length_error",
    sentence="the strip is not as long as stated",
    stage=Stage.SIZE,
    parameters=(Parameter.signed("error", "m", 0.02),),
    apply=_change_length,
    # too short it is taut, too long it buckles
    typical=lambda _: (0.0005, -0.002, 0.003),
    textile={"error": Span(-0.001, 0.002)},
    revealed_by="a ruler; a taut lift: slack or pull before the strip hangs",
)


def _add_mass(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = model.mechanics
    covered = mechanics.inside(values["position"], values["width"])
    added = values["mass"] * covered / mechanics.total(covered, mechanics.ends)
    return with_added(model, "mechanics.linear_density", added)


HEM_MASS = law_effect(
    name="hem_mass",
    sentence="a piece of the strip, such as a hem, is heavier than the rest",
    parameters=(
        Parameter("mass", "kg", low=0.0, high=0.1),
        POSITION,
        WIDTH,
    ),
    apply=_add_mass,
    typical=lambda strip: (0.05 * strip.mass,),
    textile={
        "mass": Span(2.5e-4, 1e-3, of_length=True),  # 2 to 8 % of a usual strip's
        "position": Span(0.3, 0.95, of_length=True),
        "width": Span(0.01, 0.01),
    },
    revealed_by="the strip on scales; slow folds of other heights",
)

STRETCH = law_effect(
    name="stretch",
    sentence="the strip stretches under its own weight and the pull of the gripper",
    parameters=(Parameter.limit("stiffness", "N", low=0.5, high=1e6),),
    apply=set_fields(stiffness="mechanics.stretch_stiffness"),
    typical=lambda strip: tuple(
        strip.weight / strain for strain in (0.002, 0.006, 0.02)
    ),
    textile={"stiffness": Span(6.0, 39.0, log=True)},
    revealed_by="a taut lift and a high carry: the hanging part grows longer",
)

AIR_DRAG = law_effect(
    name="air_drag",
    sentence="the air slows the strip down where it moves broadside",
    parameters=(
        Parameter("coefficient", "1", low=0.0, high=10.0),
        Parameter.shape("slow", "m/s", high=1.0, guess=0.03),
        Parameter.shape("oblique", "1", high=1.0, guess=0.3),
        Parameter.shape("along", "1", high=1.0, guess=0.1),
    ),
    apply=lambda model, values: with_field(model, "mechanics.drag", Drag(**values)),
    typical=lambda _: (0.3, 1.5),
    textile={"coefficient": Span(0.3, 1.5)},
    revealed_by="a fast fold against a slow one: the falling fold arrives late",
)

LAYER_ADHESION = law_effect(
    name="layer_adhesion",
    sentence="the layers cling to each other where they touch",
    parameters=(Parameter("force", "N/m", low=0.0, high=50.0),),
    apply=set_fields(force="mechanics.adhesion"),
    revealed_by="a run that goes on or comes back after the layers have touched",
)
