"""Advice on which further run would best tell two explanations apart."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from cell.gap.fitting import Task
from cell.gap.fitting.gauss_newton import FitEstimate, linearise
from cell.gap.fitting.model import Model, Point, requests, stated
from cell.gap.fitting.normal_equations import covariance
from cell.gap.selection.likelihood import LikelihoodScale
from cell.gap.subject.subject import Experiment
from drivers.base.types import Array


@dataclass(frozen=True, slots=True)
class Recommendation:
    """Recommended experiment: the two models that it separates, by how many sigma, and
    its duration in minutes.
    """

    experiment: str
    separates: tuple[str, str]
    expected_sigma: float
    minutes: float


def advise(
    first: FitEstimate,
    second: tuple[Model, Array],
    experiments: Sequence[Experiment],
    likelihood: LikelihoodScale,
) -> Task[list[Recommendation]]:
    """Rank `experiments` by how well they separate two models per minute of
    measurement; a task that yields simulation requests.

    `second` is a model with its shared values (P,). What the first explanation's
    parameters may still move, given the runs so far, is projected out (design for
    discrimination: Box and Hill 1967).
    """
    if not experiments:
        return []
    planned = [e.run for e in experiments]
    point = stated(planned, first.shared)
    raw, jacobians = yield from linearise(first.model, planned, point)
    model, shared = second
    other = yield requests(model, planned, Point(shared, point.local))
    information = _information(first)
    rated = []
    rows = zip(experiments, other, raw, jacobians, strict=True)
    for experiment, theirs, ours, jacobian in rows:
        run = experiment.run
        difference = np.nan_to_num((theirs.mean - ours.mean) / run.samples.scale)
        own = np.diag([p.spread**-2 for p in run.local])
        square = _unabsorbed_square(difference, jacobian, block_diag(information, own))
        sigma = np.sqrt(max(0.0, square) / likelihood.inefficiency) / likelihood.scale
        words = f"{experiment.name}: {experiment.instruction}"
        separates = (first.model.name, model.name)
        rated.append(Recommendation(words, separates, sigma, experiment.minutes))
    # by the expected log-likelihood ratio, half of sigma squared, per minute
    return sorted(rated, key=lambda a: -(a.expected_sigma**2) / a.minutes)


def _information(estimate: FitEstimate) -> Array:
    """Information matrix (P, P) on the P shared parameters of a fit, from its runs and
    priors.
    """
    count = len(estimate.shared)
    spread = covariance(estimate.normal().curvature)[:count, :count]
    return np.asarray(np.linalg.pinv(spread, hermitian=True))


def _unabsorbed_square(response: Array, jacobian: Array, prior: Array) -> float:
    """Squared norm of the part of a `response` (samples,) that no change of the fit's
    unknowns can absorb.

    `prior` (size, size) is their inverse covariance.
    """
    inverse = covariance(jacobian.T @ jacobian + prior)
    back = jacobian.T @ response
    return float(response @ response - back @ inverse @ back)
