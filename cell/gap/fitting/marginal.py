"""Marginal likelihood of run-to-run spreads, with all other unknowns integrated out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import optimize
from scipy.linalg import cho_solve

from cell.gap.fitting import robust
from cell.gap.fitting.gauss_newton import Estimate
from cell.gap.fitting.model import unknowns
from cell.gap.fitting.projection import stacked_jacobian
from cell.gap.subject.subject import Parameter
from drivers.types import Array


@dataclass(frozen=True, slots=True)
class Sought:
    """Search range of a run-to-run spread, in units of the usual one.

    From `begin`, between `smallest` and `largest`. The part of a quantity that all runs share has a
    prior `common` times as wide as the usual spread. Any fit leaves at least the share `least` of
    the stated variance. Source: set by hand; `python -m tests.lab study spreads` tests
    it on true spreads.
    """

    smallest: float = 0.03
    largest: float = 5.0
    begin: float = 0.5
    least: float = 0.1
    common: float = 10.0


SOUGHT = Sought()


@dataclass(frozen=True, slots=True)
class Marginal:
    """Quadratic model of a fit in the random unknowns of its runs alone, about zero scatter.

    `curvature` (u, u) and `pull` (u,) of data and priors, all other unknowns integrated out, in
    units of the `usual` (q,) spread of each quantity; `owner` (u,) numbers the quantity of an
    unknown.
    """

    curvature: Array
    pull: Array
    owner: Array
    usual: Array

    @classmethod
    def of(cls, estimate: Estimate, known: dict[str, Parameter]) -> Self:
        """Integrate all but the random unknowns, `known` by name, out of the linearised fit.

        The common part of a quantity counts as an unknown of its own: a constant error of the rig
        is no scatter.
        """
        every = unknowns(estimate.model, estimate.evidence)
        order = list(known)
        owner = np.array([order.index(p.name) if p.random else -1 for p in every])
        usual = np.array([known[name].spread for name in order])
        whole, pull = _equations(estimate, every, owner, usual)
        random = np.flatnonzero(owner >= 0)
        fixed = np.setdiff1d(np.arange(len(whole)), random)
        unit = usual[owner[random]]
        across = np.linalg.solve(whole[np.ix_(fixed, fixed)], whole[np.ix_(fixed, random)])
        left = whole[np.ix_(random, random)] - whole[np.ix_(random, fixed)] @ across
        return cls(
            0.5 * (left + left.T) * unit[:, None] * unit,
            (pull[random] - across.T @ pull[fixed]) * unit,
            owner[random],
            usual,
        )

    def loss(self, shares: Array, active: Sequence[int]) -> float:
        """Minus log marginal likelihood [nats] of the spreads of the quantities `active`.

        `shares` (k,) are their spreads in units of the usual ones; the loss is up to a constant. A
        half-normal prior of unit width on each share stands in where runs are few.
        """
        return self._loss(shares, active)[0]

    def least(self, active: Sequence[int], start: Array) -> tuple[float, Array]:
        """Least loss [nats] over the shares of the quantities `active`, and those shares (k,).

        `start` (j,) holds initial shares of the first quantities.
        """
        if not len(active):
            return self.loss(np.zeros(0), []), np.zeros(0)
        begin = np.log(np.concatenate([start, np.full(len(active) - len(start), SOUGHT.begin)]))
        limits = [(np.log(SOUGHT.smallest), np.log(SOUGHT.largest))] * len(active)
        found = optimize.minimize(
            lambda x: self._loss(np.exp(x), active), begin, jac=True, method="L-BFGS-B",
            bounds=limits,
        )  # fmt: skip
        return float(found.fun), np.exp(found.x)

    def _loss(self, shares: Array, active: Sequence[int]) -> tuple[float, Array]:
        """Loss [nats] of `shares` (k,) and its gradient (k,) in their logarithms."""
        place = np.full(len(self.usual), -1)
        place[list(active)] = np.arange(len(active))
        owner = place[self.owner]
        kept = np.flatnonzero(owner >= 0)
        owner = owner[kept]
        precision = shares[owner] ** -2
        whole = self.curvature[np.ix_(kept, kept)] + np.diag(precision)
        d = 1.0 / np.sqrt(np.diag(whole))  # scales the diagonal to one
        lower = np.linalg.cholesky(whole * d[:, None] * d + 1e-10 * np.eye(len(d)))
        inverse = cho_solve((lower, True), np.eye(len(d)))
        scaled = inverse @ (d * self.pull[kept])
        mean, variance = d * scaled, d**2 * np.diag(inverse)
        half_logdet = float(np.log(np.diag(lower) / d * shares[owner]).sum())
        loss = half_logdet - 0.5 * float(self.pull[kept] @ mean) + 0.5 * float(shares @ shares)
        each = 1.0 - precision * (variance + mean**2)
        return loss, np.bincount(owner, each, len(active)) + shares**2


def _equations(
    estimate: Estimate, every: Sequence[Parameter], owner: Array, usual: Array
) -> tuple[Array, Array]:
    """Curvature (u + q, u + q) and pull (u + q,) of data and priors, but those of scatter.

    In all u unknowns and in the common part of each of the q random quantities.
    """
    r = np.concatenate(estimate.residuals)
    worth = max(SOUGHT.least, robust.long_run_variance(estimate.evidence.runs, estimate.residuals))
    weight = np.sqrt(robust.weights(r / estimate.scale) / worth) / estimate.scale
    columns = stacked_jacobian(estimate)
    prior = np.array([0.0 if p.random else p.spread**-2 for p in every])
    start = np.array([p.start for p in every])
    without_scatter = r - columns @ np.where(owner >= 0, estimate.z, 0.0)
    prior_pull = prior * (estimate.z - start)
    common = np.stack([columns[:, owner == k].sum(axis=1) for k in range(len(usual))], axis=1)
    common_prior = (SOUGHT.common * usual) ** -2
    whole = np.concatenate([columns, common], axis=1) * weight[:, None]
    curvature = whole.T @ whole + np.diag(np.concatenate([prior, common_prior]))
    curvature += np.diag(1e-9 * np.diag(curvature) + 1e-12)  # keeps it positive definite
    prior_pull = np.concatenate([prior_pull, np.zeros(len(common_prior))])
    return curvature, -(whole.T @ (without_scatter * weight) + prior_pull)
