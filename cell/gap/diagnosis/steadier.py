"""What runs that repeat better would have shown: each spread from run to run halved."""

from dataclasses import dataclass

import numpy as np

from cell.gap.fitting import normal_equations
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Model, Point, requests, response
from cell.gap.fitting.projection import stacked_jacobian
from cell.gap.fitting.tasks import Task
from cell.gap.selection.likelihood import LikelihoodScale
from drivers.types import Array

REMEDY_SHARE = 0.5  # of a spread, that a remedy would leave; set by hand


@dataclass(frozen=True, slots=True)
class Steadier:
    """By how many sigma the runs made so far would separate two explanations more, had the
    quantity `name` differed from run to run by half as much.
    """

    name: str
    sigma: float


def steadier(
    first: Estimate, second: tuple[Model, Array], by: LikelihoodScale
) -> Task[list[Steadier]]:
    """Each random quantity of the runs, the one that separates best first; yields simulations.

    `second` is a model with its shared values (P,). What the first explanation's unknowns may
    absorb, each within its spread, is projected out (Box and Hill 1967).
    """
    runs = first.evidence.runs
    names = dict.fromkeys(p.name for run in runs for p in run.local if p.random)
    if not names:
        return []
    model, shared = second
    other = yield requests(model, runs, Point(shared, first.point.local))
    parts = zip(other, first.raw, first.evidence.scales, strict=True)
    moved = np.concatenate([response(*each) for each in parts])
    jacobian, limits = stacked_jacobian(first), normal_equations.bounds(first.model, first.evidence)
    owners = [p.name for p in first.model.parameters]
    owners += [p.name for run in runs for p in run.local]
    now = _square(moved, jacobian, limits.precision)
    found = []
    for name in names:
        halved = np.where(np.array(owners) == name, REMEDY_SHARE**-2, 1.0) * limits.precision
        more = max(0.0, _square(moved, jacobian, halved) - now)
        found.append(Steadier(name, more**0.5 / by.scale / by.inefficiency**0.5))
    return sorted(found, key=lambda s: -s.sigma)


def _square(moved: Array, jacobian: Array, precision: Array) -> float:
    """Squared length of a response (N,) that unknowns of this `precision` (size,) do not absorb."""
    curvature = jacobian.T @ jacobian + np.diag(precision)
    nothing = np.zeros(len(curvature))
    inverse = normal_equations.covariance(normal_equations.Normal(nothing, curvature))
    back = jacobian.T @ moved
    return float(moved @ moved) - float(back @ inverse @ back)
