"""Crease: a local rest angle of the undeformed strip."""

from collections.abc import Mapping

from drivers.strip.crease import add_crease
from drivers.strip.effects.effect import PLACE_SPAN, Effect, Parameter, Span, Stage
from drivers.strip.model import StripModel


def _apply(model: StripModel, values: Mapping[str, float]) -> StripModel:
    return add_crease(model, values["angle"], values["position"])


EFFECT = Effect(
    name="crease",
    sentence="the strip has a crease",
    of="strip",
    stage=Stage.LAW,
    parameters=(
        Parameter("angle", "rad", low=-2.0, high=2.0),
        Parameter("position", "m", low=0.0, high=2.0, null=None, role="place"),
    ),
    apply=_apply,
    typical=lambda _: (-0.3, 0.3),
    textile={"angle": Span(-0.3, 0.3), "position": PLACE_SPAN},
    revealed_by="slow folds of other heights: a bend stays at one place of the strip",
)
