"""The next experiment: which run separates two explanations best for its time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.gap.fitting import normal_equations
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import Evidence, Model, Point, evidence, requests
from cell.gap.fitting.secants import linearise
from cell.gap.fitting.tasks import Task
from cell.gap.selection.likelihood import LikelihoodScale
from cell.gap.subject.subject import Experiment
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Advice:
    """An experiment and by how many sigma it would separate two explanations."""

    experiment: Experiment
    separates: tuple[str, str]
    sigma: float

    @property
    def rate(self) -> float:
        """Nats of separation per minute."""
        return 0.5 * self.sigma**2 / self.experiment.minutes


def advise(
    first: Estimate,
    second: tuple[Model, Array],
    experiments: Sequence[Experiment],
    by: LikelihoodScale,
) -> Task[list[Advice]]:
    """Experiments by expected separation per minute, best first; yields simulations.

    `second` is a model with its shared values (P,). What the first explanation's parameters may
    still move, given the runs so far, is projected out (design for discrimination: Box and Hill
    1967).
    """
    if not experiments:
        return []
    planned = evidence([e.run for e in experiments])
    raw, jacobians = yield from linearise(
        first.model, planned, Point(first.shared, planned.start())
    )
    model, shared = second
    other = yield requests(model, planned.runs, Point(shared, planned.start()))
    known = _information(first)
    found = []
    for i, experiment in enumerate(experiments):
        response = np.nan_to_num((other[i].mean - raw[i].mean) / planned.scales[i])
        sigma = _separation(response, jacobians[i], known, planned, i)
        pair = (first.model.name, model.name)
        found.append(Advice(experiment, pair, sigma / by.scale / by.inefficiency**0.5))
    return sorted(found, key=lambda a: -a.rate)


def _information(estimate: Estimate) -> Array:
    """What the runs so far and the priors say of the shared parameters: inverse covariance."""
    count = len(estimate.shared)
    spread = normal_equations.covariance(estimate.normal())[:count, :count]
    return np.asarray(np.linalg.pinv(spread, hermitian=True))


def _separation(response: Array, jacobian: Array, known: Array, planned: Evidence, i: int) -> float:
    """Length of the response that neither shared nor own unknowns can absorb [sigma]."""
    size = jacobian.shape[1]
    curvature = jacobian.T @ jacobian
    curvature[: len(known), : len(known)] += known
    own = [p.spread**-2 for p in planned.runs[i].local]
    curvature[len(known) :, len(known) :] += np.diag(own)
    inverse = normal_equations.covariance(normal_equations.Normal(np.zeros(size), curvature))
    back = jacobian.T @ response
    square = float(response @ response) - float(back @ inverse @ back)
    return float(np.sqrt(max(0.0, square)))
