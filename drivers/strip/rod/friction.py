"""Dry friction between yarns in bending: an element that yields, and one that slides gradually."""

from typing import Any

from drivers.strip.rod.compiled import kernel
from drivers.strip.rod.lanes import below, choose, fma


@kernel
def element(stick: Any, slip: Any, change: Any, before: Any) -> Any:
    """Moment [N m] of an element after a `change` of strain, and its tangent (return mapping).

    `stick` is its stiffness, `slip` the moment at which it slides, `before` its moment before.
    """
    moment = fma(stick, change, before)
    over, under = below(slip, moment), below(moment, -slip)
    moment = choose(over, slip, choose(under, -slip, moment))
    return moment, choose(over + under, 0.0, stick)


@kernel
def gradual_element(slip: Any, pace: Any, change: Any, before: Any) -> Any:
    """Moment [N m] of an element without a yield point after a `change` of strain, and its tangent.

    dM/deps = pace (slip - s M) with s the sign of the change: Dahl's law of exponent 1. Of x = pace
    |change|, exp(-x) is taken as 1 / (1 + x + x^2 / 2 + x^3 / 6), which stays positive.
    """
    back = below(change, 0.0)
    limit, x = choose(back, -slip, slip), pace * choose(back, -change, change)
    slope = fma(x, fma(0.5, x, 1.0), 1.0)
    growth = fma(x * x, x * (1.0 / 6.0), slope)
    ahead = (limit - before) / growth  # the moment still to come
    return limit - ahead, pace * slope * choose(back, -ahead, ahead) / growth
