"""The policy `adaptive`: shifts the path until its network, the critic, predicts
displacement 0.
"""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.adaptive.critic import (
    Critic,
    CriticBias,
    CriticPrediction,
    FoldMemory,
    median_prediction,
)
from policies.adaptive.features import REFERENCE_LENGTH, Features
from policies.follower import LEAD, LOOK_AHEAD
from policies.path import Path, vertical_lift
from policies.policy import Decision, FoldPrediction, Observation

SMOOTHING_TIME = 0.08  # s, time constant of the low-pass filter on the rise
BLIND_TIME = 0.2  # s without a reliable image, after which predictions are not used
RECENT_PREDICTIONS = 5  # newest predictions, whose median is reported
LENGTH_RANGE = (0.45, 0.75)  # m, of strips that the critic was trained on
SPEED, SPEED_TOLERANCE = 0.1, 0.015  # m/s, of folds that the critic was trained on
# of the length, rise without any prediction: that of the policy `shifted`
BLIND_RISE = 0.07
HIGHEST = 1 / 6  # of the length, largest rise
LEVELLING_HEIGHT = 0.02  # m of height, under which the gripper goes level
PAST = -0.15  # x over the length, at which a fold has ended
UP_DIRECTION, DOWN_DIRECTION, LEVEL_DIRECTION = 0.75 * math.pi, 1.25 * math.pi, math.pi


class Steering:
    """Steering of n grippers along raised triangles: each goes up, then down, and never
    up again.
    """

    def __init__(self, length: float, speed: float, count: int) -> None:
        """Steer `count` grippers over strips of `length` [m] at `speed` [m/s]."""
        self._length = length
        self._speed = speed
        self.descending: NDArray[np.bool_] = np.zeros(count, dtype=bool)

    @property
    def highest(self) -> float:
        """Largest rise [m] of the lines along which grippers descend."""
        return HIGHEST * self._length

    def decide(self, x: Array, z: Array, rise: Array) -> Decision:
        """Command grippers at `x`, `z` (n,) [m] up to the line z = x + `rise` (n,) [m],
        then down along it.
        """
        above = (z - x - rise) / math.sqrt(2.0)
        self.descending = self.descending | (above > -self._speed * LEAD)
        turn = np.arctan2(above, LOOK_AHEAD)
        down = DOWN_DIRECTION + np.clip(turn, -math.pi / 4, math.pi / 4)
        direction = np.where(self.descending, down, UP_DIRECTION)
        direction = np.where(
            self.descending & (z < LEVELLING_HEIGHT), LEVEL_DIRECTION, direction
        )
        done = x < PAST * self._length
        speed = np.where(done, 0.0, self._speed)
        return Decision(direction, speed, done)


class Adaptive:
    """Policy that descends on lines z = x + rise whose predicted displacement is zero.

    `rise` (n,) [m] are those of the n grippers' lines. After BLIND_TIME without an
    image of sufficient confidence, `blind` is set and the rise goes to that of the
    policy `shifted`.
    """

    name = "adaptive"

    def __init__(self, critic: Critic, bias: CriticBias | None = None) -> None:
        """Policy with `critic`; `bias` corrects its predictions, None in simulated
        folds.
        """
        self.critic = critic
        self.bias = bias or CriticBias()
        self._seen = 0.0
        self._recent: deque[CriticPrediction] = deque(maxlen=RECENT_PREDICTIONS)
        self.blind: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._thickness: float | None = None
        self._begin(REFERENCE_LENGTH, SPEED, 1)

    def correct(self, bias: float) -> None:
        """Shift the aim by `bias` [m], the measured less the predicted displacement."""
        self._seen = bias

    def reset(self, strip: StripFile, speed: float, count: int) -> None:
        """Forget the last fold, and prepare for `count` strips of the length of `strip`
        at `speed` [m/s].

        Raises ConfigurationError for a length or speed that the critic was not trained
        for.
        """
        _check_range(strip.length, speed)
        self._recent.clear()
        self._thickness = None if "thickness" in strip.spread else strip.thickness
        self._begin(strip.length, speed, count)

    def _begin(self, length: float, speed: float, count: int) -> None:
        """Begin `count` folds of strips of `length` [m] at `speed` [m/s], before any
        image.
        """
        self._length = length
        self._steering = Steering(length, speed, count)
        self._features = Features(length, count)
        self._memory = FoldMemory(count, self.critic.memory)
        self.rise: Array = np.full(count, BLIND_RISE * length)
        # times (n,) [s] of the last decision
        self._decided: Array = np.full(count, np.nan)

    def lift(self) -> Path:
        """Path of the lift: vertical at first, so that the strip is not pushed along
        the desk.
        """
        return vertical_lift(self._length)

    def prediction(self) -> FoldPrediction | None:
        """Predicted displacement and properties of the batch's first strip; None before
        the first decision.
        """
        if not self._recent:
            return None
        predicted = median_prediction(self._recent)
        bias = self.bias.estimate(predicted.belief, self._thickness)
        return FoldPrediction(
            displacement=float(predicted.displacement[0] - bias[0] + self._seen),
            sigma=float(self.bias.sigma_of(predicted.sigma, self._thickness)[0]),
            **predicted.belief.first(),
            blind=bool(self.blind[0]),
        )

    def decide(self, observation: Observation) -> Decision:
        """Command to descend on the line z = x + rise whose predicted displacement is
        zero.
        """
        fresh = self._features.add(observation)
        inputs = self._features.inputs(
            observation, self.rise, self._steering.descending
        )
        prediction = self._predict(inputs, fresh)
        self.blind = observation.time - self._features.newest > BLIND_TIME
        self.rise = self._smooth_rise(prediction, observation.time)
        self._decided = observation.time
        return self._steering.decide(observation.x, observation.z, self.rise)

    def _predict(self, inputs: Array, fresh: NDArray[np.bool_]) -> CriticPrediction:
        """Prediction from `inputs` (n, COUNT); inputs of `fresh` images (n,) enter the
        memory.
        """
        critic = self.critic
        whitened = critic.whiten(inputs)
        memory = self._memory.add(critic.memorise(whitened), fresh)
        prediction = critic.predict(whitened, memory)
        self._recent.append(prediction)
        return prediction

    def _smooth_rise(self, prediction: CriticPrediction, time: Array) -> Array:
        """Rises (n,) [m], low-pass filtered, for which a displacement of 0 is
        predicted.
        """
        bias = self.bias.estimate(prediction.belief, self._thickness)
        correction = bias - self._seen - prediction.displacement
        target = self.rise + correction / prediction.slope
        target = np.where(self.blind, BLIND_RISE * self._length, target)
        target = np.clip(target, 0.0, self._steering.highest)
        # the first decision takes the target without smoothing
        elapsed = np.clip(np.nan_to_num(time - self._decided, nan=math.inf), 0.0, None)
        gain = 1.0 - np.exp(-elapsed / SMOOTHING_TIME)
        return self.rise + gain * (target - self.rise)


def _check_range(length: float, speed: float) -> None:
    """Raise ConfigurationError for a `length` [m] or `speed` [m/s] outside the
    training's range.
    """
    low, high = LENGTH_RANGE
    if not low <= length <= high:
        raise ConfigurationError(
            f"adaptive: the strip is {length:g} m long, the policy knows {low:g} to"
            f" {high:g} m"
        )
    if abs(speed - SPEED) > SPEED_TOLERANCE:
        raise ConfigurationError(
            f"adaptive: the cell folds at {speed:g} m/s, the policy knows {SPEED:g}"
            " m/s; set fold.speed in cell.yaml"
        )
