"""Mass added to one section of the strip, such as a hem."""

from collections.abc import Mapping
from dataclasses import replace

from drivers.strip.effects.effect import Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel
from drivers.types import frozen


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    mechanics = model.mechanics
    covered = mechanics.inside(values["position"], values["width"])
    added = values["mass"] * covered / mechanics.total(covered, mechanics.ends)
    density = frozen(mechanics.linear_density + added)
    return replace(model, mechanics=replace(mechanics, linear_density=density))


EFFECT = Effect(
    name="hem_mass",
    sentence="a piece of the strip, such as a hem, is heavier than the rest",
    of="strip",
    stage=Stage.LAW,
    parameters=(
        Parameter("mass", "kg", low=0.0, high=0.1),
        Parameter("position", "m", low=0.0, high=2.0, null=None, role="place"),
        Parameter("width", "m", low=0.001, high=0.5, null=None, role="width"),
    ),
    apply=_apply,
    typical=lambda strip: (0.05 * strip.mass,),
    textile={
        "mass": Span(2.5e-4, 1e-3, of_length=True),  # 2 to 8 % of a usual strip's
        "position": Span(0.3, 0.95, of_length=True),
        "width": Span(0.01, 0.01),
    },
    revealed_by="the strip on scales; slow folds of other heights",
)
