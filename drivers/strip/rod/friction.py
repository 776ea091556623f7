"""Dry friction between yarns, modelled as an elasto-plastic element in bending."""

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
