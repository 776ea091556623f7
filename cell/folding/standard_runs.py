"""Standard runs for comparing simulation and measurement of a strip."""

from dataclasses import replace

import numpy as np

from cell.folding.request import Request
from cell.folding.result import FoldResult
from cell.record.header import NOT_FOLDED
from policies.experiments.standard import STANDARD, standard_order
from policies.registry import MOTION

AS_PLANNED = frozenset({"layer_touch", "path_done"}) | NOT_FOLDED
"""Outcomes of a standard run that can be used whole: a lift there and back ends without a touch,
and how the strip lies afterwards is not compared with anything.
"""


def standard_requests(base: Request) -> tuple[Request, ...]:
    """Requests of the standard runs, shuffled by the seed S; number i has seed S + i, index i."""
    order = standard_order(np.random.default_rng(base.choice.seed))
    return tuple(
        replace(
            base,
            policy=MOTION + name,
            speed=STANDARD[name].speed,
            choice=replace(base.choice, index=i, seed=base.choice.seed + i),
        )
        for i, name in enumerate(order)
    )


def standard_run(request: Request) -> tuple[str, str]:
    """Name of the standard run that `request` asks for, and the effects that it reveals."""
    name = request.policy.removeprefix(MOTION)
    return name, STANDARD[name].reveals


def went_as_planned(result: FoldResult) -> bool:
    """Whether a standard run ended so that all of it can be used for a fit."""
    return result.outcome in AS_PLANNED
