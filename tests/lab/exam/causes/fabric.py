"""Hidden causes in the fabric: bending, damping, creep, what changes from run to
run.
"""

from typing import ClassVar

import mujoco
import numpy as np
from pydantic import Field

from drivers.base.types import Array
from drivers.strip.model import StripModel, scale_rigidity, with_field
from drivers.twin.chain.forces import DahlFriction, ForceFunction, Parts, resistance
from tests.lab.exam.causes.cause import Cause, Sizes


class Dahl(Cause):
    """Dahl's friction in addition to the elastic moment, in place of elasto-plastic
    elements.

    The friction moment M obeys dM/dkappa = ratio EI (1 - s M / M_c)^exponent, where s
    is the sign of the curvature's rate and M_c = `yield_curvature` EI. Source: Dahl,
    Solid friction damping of mechanical vibrations, AIAA Journal 14(12), 1976;
    `exponent` is his i.
    """

    amount: ClassVar[str] = "yield_curvature"
    answers: ClassVar[str | None] = "bending_hysteresis"

    yield_curvature: float = Field(ge=0, le=100)  # 1/m
    ratio: float = Field(8.0, ge=1, le=50)  # of pre-sliding over bending stiffness
    exponent: float = Field(1.5, ge=1.0, le=3.0)

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Friction moment of every hinge, zero at the start."""
        stiffness = parts.lumps.hinges.stiffness
        element = DahlFriction(
            stiffness * self.yield_curvature * parts.lumps.hinges.reach,
            self.ratio * stiffness,
            self.exponent,
        )
        return resistance(parts, element)


# curvature in units of k_s from which on the nonlinear moment stays constant
LINEAR_FROM = 6.0


class SinhBending(Cause):
    """Elastic moment M = EI k_s sinh(kappa / k_s), or tanh where `cubic` is negative.

    `cubic` [m^2] is the coefficient of the law's own series: 1 / (6 k_s^2) for sinh and
    -1 / (3 k_s^2) for tanh. Source of the saturating law: friction couples of yarns,
    Grosberg, The mechanical properties of woven fabrics II, Text. Res. J. 36, 1966;
    sinh is assumed.
    """

    amount: ClassVar[str] = "cubic"
    answers: ClassVar[str | None] = "nonlinear_bending"

    cubic: float = Field(ge=-1e-3, le=1e-3)  # m^2

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Moment added to the elastic one at every hinge."""
        hard = self.cubic > 0
        bend = np.sqrt(1.0 / ((6.0 if hard else 3.0) * abs(self.cubic)))
        lumps = parts.lumps.hinges
        return resistance(parts, Excess(lumps.stiffness, bend * lumps.reach, hard=hard))


class Excess:
    """Nonlinear part of a sinh or tanh bending law with the angle `scale` (n + 1,)
    [rad].
    """

    def __init__(self, stiffness: Array, scale: Array, *, hard: bool) -> None:
        self._stiffness, self._scale, self._hard = stiffness, scale, hard

    def __call__(self, angle: Array, rate: Array, h: float) -> tuple[Array, Array]:
        """Nonlinear moment (n + 1,) [N m] and its slope [N m/rad] at `angle` (n + 1,)
        [rad].
        """
        x = np.clip(angle / self._scale, -LINEAR_FROM, LINEAR_FROM)
        value = np.sinh(x) if self._hard else np.tanh(x)
        slope = np.cosh(x) if self._hard else 1.0 / np.cosh(x) ** 2
        return self._stiffness * self._scale * (value - x), self._stiffness * (
            slope - 1.0
        )


ELEMENTS = 4


class LogCreep(Cause):
    """A share `ratio` of the rigidity relaxes evenly in log time from `quick` to `slow`
    [s].

    Four Maxwell elements whose times are spaced evenly in the logarithm. Source: stress
    relaxation of fibres is linear in log time over decades, Morton and Hearle, Physical
    Properties of Textile Fibres, chapter on rheology.
    """

    amount: ClassVar[str] = "ratio"
    answers: ClassVar[str | None] = "relaxation"

    ratio: float = Field(ge=0, le=0.9)
    quick: float = Field(0.1, gt=0, le=10)  # s
    slow: float = Field(5.0, gt=0, le=1000)  # s

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Moment that every hinge loses by creep."""
        times = np.geomspace(self.quick, self.slow, ELEMENTS)
        share = self.ratio / ELEMENTS * parts.lumps.hinges.stiffness
        return resistance(parts, Fading(share, parts.lumps.hinges.rest_angle, times))


class Fading:
    """Maxwell elements of equal stiffness `share` (n + 1,) [N m/rad] and `times` (k,)
    [s].
    """

    def __init__(self, share: Array, rest: Array, times: Array) -> None:
        self._share, self._rest, self._times = share, rest, times[:, None]
        self._strain = np.zeros((len(times), len(share)))
        self._angle = 0.0 * share
        self._elapsed = 0.0

    def __call__(self, angle: Array, rate: Array, h: float) -> tuple[Array, Array]:
        """Moments [N m] lost by relaxation, negative, and zero slopes; dq = da - q dt /
        T.
        """
        past = self._elapsed / self._times
        kept = np.ones_like(past) if self._elapsed == 0 else -np.expm1(-past) / past
        self._strain = np.exp(-past) * self._strain + kept * (angle - self._angle)
        self._angle, self._elapsed = angle, h
        lost = (angle - self._rest - self._strain).sum(axis=0)
        return -self._share * lost, np.zeros_like(angle)


class PowerDamping(Cause):
    """Adds a moment EI `coefficient` r^2 (|kappa'| / r)^exponent against the rate
    kappa'.

    At the rate r it is that of the library's quadratic law. Source: the power law of
    Ostwald and de Waele, here of a dashpot; the exponent is assumed.
    """

    amount: ClassVar[str] = "coefficient"
    answers: ClassVar[str | None] = "quadratic_damping"

    coefficient: float = Field(ge=0, le=1.0)  # m s^2
    exponent: float = Field(1.7, ge=1.2, le=3.0)
    rate: float = Field(60.0, gt=0, le=1000)  # 1/(m s), r

    def begin(self, parts: Parts, rng: np.random.Generator) -> ForceFunction:
        """Nonlinear damping of every hinge."""
        hinges = parts.joints.hinges
        span = parts.lumps.hinges.reach
        # moment = K span c r^2 (|w| / (span r))^p = [K c r (|w| / (span r))^(p - 1)] w
        size = parts.lumps.hinges.stiffness * self.coefficient * self.rate

        def act(
            model: mujoco.MjModel, data: mujoco.MjData, _: float, __: float
        ) -> None:
            part = np.abs(data.qvel[hinges]) / (span * self.rate)
            model.dof_damping[hinges] += size * part ** (self.exponent - 1.0)

        return act


class SmoothGradient(Cause):
    """Rigidity factor 1 + slope / 2 sin(pi (s / L - 1/2)), at both ends that of a
    linear gradient.

    Source: assumed; finishes and dyes vary like that from selvedge to middle.
    """

    amount: ClassVar[str] = "slope"
    answers: ClassVar[str | None] = "stiffness_gradient"

    slope: float = Field(gt=-2, lt=2)

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model with the S-shaped profile of rigidity."""
        mechanics = model.mechanics
        share = mechanics.cells / mechanics.length - 0.5
        return scale_rigidity(model, 1.0 + 0.5 * self.slope * np.sin(np.pi * share))


class SoftSeam(Cause):
    """Rigidity factor 1 + (factor - 1) exp(-(s - position)^2 / (2 sigma^2)) along the
    strip.

    sigma = width / sqrt(2 pi), so that a seam of the library as wide and as stiff has
    the same integral. Source: assumed; glue and overlocked edges fade out.
    """

    amount: ClassVar[str] = "factor"
    null: ClassVar[float] = 1.0
    answers: ClassVar[str | None] = "seam"

    factor: float = Field(ge=0.1, le=50)
    position: float = Field(0.3, ge=0, le=2)  # m
    width: float = Field(0.03, ge=0.005, le=0.3)  # m

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model with the rigidity of the seam."""
        mechanics = model.mechanics
        away = (mechanics.cells - self.position) / self.width
        return scale_rigidity(
            model, 1.0 + (self.factor - 1.0) * np.exp(-np.pi * away**2)
        )


class BrokenIn(Cause):
    """Multiplies the rigidity by `factor` from run `first` on; the retardation time
    stays.

    Source: assumed; a size or finish that cracks when it is first bent sharply.
    """

    amount: ClassVar[str] = "factor"
    null: ClassVar[float] = 1.0
    sizes: ClassVar[Sizes] = {"medium": {"factor": 0.45}, "strong": {"factor": 0.3}}

    factor: float = Field(gt=0.05, le=5)
    first: int = Field(5, ge=1, le=100)

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model of this run, its rigidity multiplied by `factor` from run `first`
        on.
        """
        if model.index < self.first:
            return model
        return scale_rigidity(model, self.factor)


class Humidity(Cause):
    """Multiplies the rigidity by exp(spread g), with a new standard normal g in each
    run.

    The retardation time falls with its square root. Source: the bending modulus of
    cotton falls by some 2 % for each per cent of relative humidity (Morton and Hearle,
    Physical Properties of Textile Fibres); the rest is assumed.
    """

    amount: ClassVar[str] = "spread"
    sizes: ClassVar[Sizes] = {"medium": {"spread": 0.45}, "strong": {"spread": 0.8}}

    spread: float = Field(ge=0, le=1)

    def alter(self, model: StripModel, rng: np.random.Generator) -> StripModel:
        """Strip model with the rigidity and retardation time of this run's humidity."""
        factor = float(np.exp(self.spread * rng.standard_normal()))
        scaled = scale_rigidity(model, factor)
        viscosity = scaled.mechanics.viscosity / np.sqrt(factor)
        return with_field(scaled, "mechanics.viscosity", viscosity)
