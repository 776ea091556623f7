"""Advice on how to tell two explanations apart: by a new experiment, or by better repeats."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from cell.gap.fitting.gauss_newton import Estimate, linearise
from cell.gap.fitting.model import Model, Point, evidence, requests, response
from cell.gap.fitting.normal_equations import covariance
from cell.gap.fitting.tasks import Task
from cell.gap.selection.likelihood import LikelihoodScale
from cell.gap.subject.subject import Experiment
from drivers.types import Array

REMEDY_SHARE = 0.5  # of a spread from run to run, that a remedy would leave; set by hand


@dataclass(frozen=True, slots=True)
class RatedExperiment:
    """An experiment, and by how many `sigma` it would separate two explanations."""

    experiment: Experiment
    separates: tuple[str, str]
    sigma: float

    @property
    def rate(self) -> float:
        """Expected log-likelihood ratio of the two explanations per minute [nats/min]."""
        return 0.5 * self.sigma**2 / self.experiment.minutes


def advise(
    first: Estimate,
    second: tuple[Model, Array],
    experiments: Sequence[Experiment],
    likelihood: LikelihoodScale,
) -> Task[list[RatedExperiment]]:
    """Experiments by how well they separate two models, per minute, best first; yields requests.

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
        difference = np.nan_to_num((other[i].mean - raw[i].mean) / planned.scales[i])
        own = np.diag([p.spread**-2 for p in planned.runs[i].local])
        square = _unabsorbed_square(difference, jacobians[i], block_diag(known, own))
        sigma = likelihood.standardise(float(np.sqrt(max(0.0, square))))
        found.append(RatedExperiment(experiment, (first.model.name, model.name), sigma))
    return sorted(found, key=lambda a: -a.rate)


def _information(estimate: Estimate) -> Array:
    """Information (P, P) of runs and priors on the shared parameters: inverse covariance."""
    count = len(estimate.shared)
    spread = covariance(estimate.normal().curvature)[:count, :count]
    return np.asarray(np.linalg.pinv(spread, hermitian=True))


def _unabsorbed_square(response: Array, jacobian: Array, prior: Array) -> float:
    """Squared norm of the part of a response (N,) that the unknowns cannot absorb.

    `prior` (size, size) is their inverse covariance.
    """
    inverse = covariance(jacobian.T @ jacobian + prior)
    back = jacobian.T @ response
    return float(response @ response) - float(back @ inverse @ back)


def separation_by_steadier_runs(
    first: Estimate, second: tuple[Model, Array], likelihood: LikelihoodScale
) -> Task[dict[str, float]]:
    """Separation [sigma] of two models that halving a run-to-run spread would add, by its name.

    It adds in quadrature, as that of a further experiment does (RatedExperiment). `second` is a
    model with its shared values (P,). What the first explanation's unknowns may absorb, each within
    its spread, is projected out. A task that yields requests.
    """
    runs, unknowns = first.evidence.runs, first.unknowns
    names = dict.fromkeys(p.name for p in unknowns.parameters if p.random)
    if not names:
        return {}
    model, shared = second
    other = yield requests(model, runs, Point(shared, first.point.local))
    parts = zip(other, first.raw, first.evidence.scales, strict=True)
    difference = np.concatenate([response(*each) for each in parts])
    jacobian, precision = first.stacked_jacobian, unknowns.precision
    today = _unabsorbed_square(difference, jacobian, np.diag(precision))
    added = {}
    for name in names:
        factor = [REMEDY_SHARE**-2 if p.name == name else 1.0 for p in unknowns.parameters]
        steadier = _unabsorbed_square(difference, jacobian, np.diag(np.array(factor) * precision))
        added[name] = likelihood.standardise(max(0.0, steadier - today) ** 0.5)
    return dict(sorted(added.items(), key=lambda each: -each[1]))
