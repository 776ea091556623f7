"""Protocol of policies: from an observation to a command of the gripper, for n
strips, and to a prediction of the fold.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.path import FoldLine, Path


@dataclass(frozen=True, slots=True)
class Observation:
    """Observation of n strips, the input of a policy; arrays (n,) unless stated, [m]
    and [s].

    `x`, `z` are the gripper's, measured now; `contact_x` is the desk contact and
    `tip_x`, `tip_z` the fold's rightmost point at `stamp`, the time of the newest
    image; `time` is now. NaN marks what was not seen. `profile` (n, m, 2) is the
    midline from the desk contact to the gripper at `stamp`, the gripper being its last
    point, and `profile_confidence` (n,) from 0 to 1 its reliability; both are empty
    where profiles are not measured.
    """

    time: Array
    x: Array
    z: Array
    stamp: Array
    contact_x: Array
    tip_x: Array
    tip_z: Array
    profile: Array = field(default_factory=lambda: np.empty((0, 0, 2)))
    profile_confidence: Array = field(default_factory=lambda: np.empty(0))


class Decision(NamedTuple):
    """Command for n grippers, the output of a policy; arrays (n,).

    `direction` phi from the x-axis [rad], `speed` [m/s], and `done` where the policy
    has finished.
    """

    direction: Array
    speed: Array
    done: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """Estimated parameter of the simulated rod that a policy steers by, with a 68 %
    interval.

    It absorbs effects that the rod lacks, so it is effective: on the twin the interval
    contains the strip's true bending length in a third of the folds (the laboratory's
    study `unknown`).
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class FoldPrediction:
    """Prediction of a fold's `displacement` and its standard deviation `sigma` [m].

    With estimates of the strip's bending length [m], retardation time [s] and yield
    curvature of yarn friction [1/m]. With `blind` no image is reliable at present.
    """

    displacement: float
    sigma: float
    bending_length: ParameterEstimate
    retardation_time: ParameterEstimate
    yield_curvature: ParameterEstimate
    blind: bool

    def sentence(self) -> str:
        """Text with the predicted displacement and its sigma, for the operator."""
        distance = 1e3 * self.displacement
        sigma = 1e3 * self.sigma
        return f"predicted displacement {distance:+.1f} mm, sigma {sigma:.1f} mm"


@runtime_checkable
class Predictor(Protocol):
    """Protocol of a policy that predicts the result of its fold."""

    def prediction(self) -> FoldPrediction | None:
        """Prediction for the first fold of the batch; None before the first
        decision.
        """


class Policy(Protocol):
    """Protocol of a folding policy, which converts observations to commands of the
    gripper.
    """

    name: str

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Clear all state; prepare for `count` strips as long as `strip`, at `speed`
        [m/s].
        """

    def lift(self) -> Path:
        """Path whose first section lifts the edge from (L, 0) to the take-over
        height.
        """

    def decide(self, observation: Observation) -> Decision:
        """Command for the gripper of each strip, from the newest `observation`."""


class AtLine:
    """Policy that folds strips along `line`, using a `policy` made for half folds.

    That one sees the part of the strip that is folded, as if its fixed edge lay at
    x = 0.
    """

    def __init__(self, policy: Policy, line: FoldLine) -> None:
        self.name = policy.name
        self._policy = policy
        self._line = line
        self._shift = np.array([line.goal, 0.0])

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Clear all state and prepare for `strip`; raises ConfigurationError where its
        folded part cannot be folded in half.
        """
        try:
            self._policy.reset(folded_part(strip, self._line), speed, count)
        except ConfigurationError as error:
            raise ConfigurationError(
                f"--at: folds {self._line.span:g} m of the strip in half: {error}"
            ) from None

    def lift(self) -> Path:
        """Path whose first section lifts the edge of the whole strip."""
        return Path.through(self._policy.lift().points + self._shift)

    def decide(self, observation: Observation) -> Decision:
        """Command for the gripper of each strip, from the newest `observation`."""
        goal = self._line.goal
        return self._policy.decide(
            replace(
                observation,
                x=observation.x - goal,
                contact_x=observation.contact_x - goal,
                tip_x=observation.tip_x - goal,
                profile=observation.profile - self._shift,
            )
        )

    def prediction(self) -> FoldPrediction | None:
        """Prediction of the fold's displacement, relative to the line's goal; None
        where the policy makes none.
        """
        policy = self._policy
        return policy.prediction() if isinstance(policy, Predictor) else None


def at_line(policy: Policy, line: FoldLine) -> Policy:
    """Policy that folds along `line` as `policy` folds in half; `policy` itself where
    `line` is the middle.
    """
    return policy if line.is_half else AtLine(policy, line)


def folded_part(strip: StripFile, line: FoldLine) -> StripFile:
    """Copy of `strip` without the part that is not folded, its effects at their
    positions in the copy.
    """
    effects = {}
    for name, parameters in strip.effects.items():
        position = parameters.get("position", line.length) - line.goal
        if position < 0.0:
            continue  # in the part that stays on the desk
        moved = {"position": position} if "position" in parameters else {}
        effects[name] = {**parameters, **moved}
    return strip.model_copy(update={"length": line.span, "effects": effects})
