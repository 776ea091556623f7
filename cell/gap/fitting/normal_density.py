"""Normal density of a few amounts, and how a run that responds to them changes it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cell.gap.fitting import robust
from drivers.types import Array

REWEIGHTED = 3  # times that robust weights are renewed; set by hand


@dataclass(frozen=True, slots=True)
class NormalDensity:
    """Normal density of amounts (k,): their `mean` (k,) and `precision` (k, k)."""

    mean: Array
    precision: Array

    @classmethod
    def standard(cls, size: int) -> Self:
        """Density of `size` independent amounts of mean zero and one standard deviation."""
        return cls(np.zeros(size), np.eye(size))

    def condition(self, r: Array, responses: Array) -> tuple[Self, float]:
        """Density given a run with residuals `r` (n,), and minus the log density of the run [nats].

        Residuals change by `responses` (n, k) with the amounts. Both are by Laplace's approximation
        under the robust loss; the loss leaves out the constant of unit noise.
        """
        mean: Array = self.mean
        curvature = self.precision
        for _ in range(REWEIGHTED):
            weighed = responses * robust.weights(r + responses @ mean)[:, None]
            curvature = weighed.T @ responses + self.precision
            pull = weighed.T @ r - self.precision @ self.mean
            mean = np.asarray(-np.linalg.solve(curvature, pull))
        moved = mean - self.mean
        loss = float(robust.bounded_loss(r + responses @ mean).sum())
        loss += 0.5 * float(moved @ self.precision @ moved)
        loss += 0.5 * float(np.linalg.slogdet(curvature)[1] - np.linalg.slogdet(self.precision)[1])
        return type(self)(mean, curvature), loss
