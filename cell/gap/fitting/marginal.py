"""Marginal likelihood of how much quantities differ from run to run, all else integrated out."""

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
    """Where a spread from run to run is sought, in units of the `usual` one. Source: set by
    hand; `cell study spreads` holds what comes of it against true spreads.

    Between `smallest` and `largest`, from `begin`; the common part of a quantity may be so many
    times its usual spread (`common`). Any fit leaves at least the share `least` of the stated
    variance.
    """

    smallest: float = 0.03
    largest: float = 5.0
    begin: float = 0.5
    least: float = 0.1
    common: float = 10.0


SOUGHT = Sought()


@dataclass(frozen=True, slots=True)
class Marginal:
    """The quadratic model of a fit about zero scatter, in the random unknowns of its runs alone.

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
        """The model of the linearised fit; `known` are the random unknowns by name.

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
        """Minus log marginal likelihood [nats], up to a constant, where the quantities `active`
        scatter by `shares` (k,) of the usual.

        A half-normal prior of unit width on each share stands in where runs are few.
        """
        return self._loss(shares, active)[0]

    def least(self, active: Sequence[int], start: Array) -> tuple[float, Array]:
        """The least loss [nats] over the shares of `active`, and these (k,); sought from `start`
        for the first of them.
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
        """The loss, and what it changes by with the logarithm of each share (k,)."""
        place = np.full(len(self.usual), -1)
        place[list(active)] = np.arange(len(active))
        mine = place[self.owner]
        kept = np.flatnonzero(mine >= 0)
        mine = mine[kept]
        precision = shares[mine] ** -2
        whole = self.curvature[np.ix_(kept, kept)] + np.diag(precision)
        d = 1.0 / np.sqrt(np.diag(whole))
        lower = np.linalg.cholesky(whole * d[:, None] * d + 1e-10 * np.eye(len(d)))
        inverse = cho_solve((lower, True), np.eye(len(d)))
        scaled = inverse @ (d * self.pull[kept])
        moved, variance = d * scaled, d**2 * np.diag(inverse)
        half_logdet = float(np.log(np.diag(lower) / d * shares[mine]).sum())
        loss = half_logdet - 0.5 * float(self.pull[kept] @ moved) + 0.5 * float(shares @ shares)
        each = 1.0 - precision * (variance + moved**2)
        return loss, np.bincount(mine, each, len(active)) + shares**2


def _equations(
    estimate: Estimate, every: Sequence[Parameter], owner: Array, usual: Array
) -> tuple[Array, Array]:
    """Curvature (u + q, u + q) and pull (u + q,) of data and priors in all unknowns and in the
    common part of each random quantity, the random ones' own priors left out.
    """
    r = np.concatenate(estimate.residuals)
    worth = max(SOUGHT.least, robust.long_run_variance(estimate.evidence.runs, estimate.residuals))
    weight = np.sqrt(robust.weights(r / estimate.scale) / worth) / estimate.scale
    columns = stacked_jacobian(estimate)
    prior = np.array([0.0 if p.random else p.spread**-2 for p in every])
    start = np.array([p.start for p in every])
    target = r - columns @ np.where(owner >= 0, estimate.z, 0.0)
    pull = prior * (estimate.z - start)
    common = np.stack([columns[:, owner == k].sum(axis=1) for k in range(len(usual))], axis=1)
    more = (SOUGHT.common * usual) ** -2
    whole = np.concatenate([columns, common], axis=1) * weight[:, None]
    curvature = whole.T @ whole + np.diag(np.concatenate([prior, more]))
    curvature += np.diag(1e-9 * np.diag(curvature) + 1e-12)
    added = np.zeros(len(more))
    return curvature, -(whole.T @ (target * weight) + np.concatenate([pull, added]))
