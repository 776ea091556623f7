"""Hidden cause: bending stiffness that decays with the logarithm of time."""

from typing import ClassVar

import numpy as np
from pydantic import Field

from drivers.twin.chain.forces import ForceFunction, Parts, resistance
from drivers.types import Array
from tests.lab.exam.causes.cause import Cause

ELEMENTS = 4


class LogCreep(Cause):
    """A share `ratio` of the rigidity relaxes evenly in log time from `quick` to `slow` [s].

    Four Maxwell elements whose times are spaced evenly in the logarithm. Source: stress
    relaxation of fibres is linear in log time over decades, Morton and Hearle, Physical
    Properties of Textile Fibres, chapter on rheology.
    """

    amount: ClassVar[str] = "ratio"
    answers: ClassVar[str | None] = "relaxation"

    ratio: float = Field(ge=0, le=0.9)
    quick: float = Field(0.1, gt=0, le=10)  # s
    slow: float = Field(5.0, gt=0, le=1000)  # s

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction | None:
        """Moment that every hinge loses by creep; None without creep."""
        if self.ratio == 0:
            return None
        times = np.geomspace(self.quick, self.slow, ELEMENTS)
        share = self.ratio / ELEMENTS * parts.lumps.stiffness
        return resistance(parts, Fading(share, parts.lumps.rest, times))


class Fading:
    """Maxwell elements of equal stiffness `share` (n + 1,) [N m/rad] and `times` (k,) [s]."""

    def __init__(self, share: Array, rest: Array, times: Array) -> None:
        self._share, self._rest, self._times = share, rest, times[:, None]
        self._strain = np.zeros((len(times), len(share)))
        self._angle = 0.0 * share
        self._elapsed = 0.0

    def __call__(self, angle: Array, rate: Array, h: float) -> tuple[Array, Array]:
        """Moments [N m] lost by relaxation, negative, and zero slopes; dq = da - q dt / T."""
        past = self._elapsed / self._times
        kept = np.ones_like(past) if self._elapsed == 0 else -np.expm1(-past) / past
        self._strain = np.exp(-past) * self._strain + kept * (angle - self._angle)
        self._angle, self._elapsed = angle, h
        lost = (angle - self._rest - self._strain).sum(axis=0)
        return -self._share * lost, np.zeros_like(angle)


CAUSE = LogCreep
