"""Dynamics of an emulated arm: joint torques, deflection under load, delay and lag."""

from collections import deque
from collections.abc import Callable
from enum import StrEnum

import mujoco
import numpy as np

from drivers.base.motion import TICK, lag_gain
from drivers.base.types import Array
from drivers.franka.kinematics import FLANGE
from drivers.franka.model import ArmModel, ArmPlant
from drivers.twin.fci_server.posture import Posture, Rates, zero_rates

FRICTION_WIDTH = 0.005  # rad/s over which dry friction changes sign
FILTER_TIME = 0.02  # s, of filtered rates
LATE_TICKS = 5  # ticks, of late rates

Sag = Callable[[Posture], Array]


class RateReport(StrEnum):
    """How the emulated robot reports the rates of its commanded joints: exactly,
    filtered, late, as zero, or as measured.
    """

    EXACT = "exact"
    FILTERED = "filtered"
    LATE = "late"
    ZERO = "zero"
    MEASURED = "measured"


class Dynamics:
    """Joint torques of the emulated arm: those of the published model with the
    friction, load and sensor errors of `plant`.
    """

    def __init__(self, plant: ArmPlant) -> None:
        """Build the arm's model with mass errors and tilt of `plant`, the hand's mass
        unchanged.
        """
        self._plant = plant
        self._arm = ArmModel()
        model = self._arm.model
        for number, error in enumerate(plant.mass_error, start=1):
            link = model.body(f"link{number}")
            link.mass *= 1.0 + error
            link.inertia *= 1.0 + error
        model.opt.gravity[:] = _tilt(float(model.opt.gravity[2]), *plant.tilt)
        self._payload_point = np.add(plant.payload_at, (0.0, 0.0, FLANGE))

    def torque(self, posture: Posture) -> Array:
        """Torques (7,) [N m] of the joints that give the arm the position and motion in
        `posture`.
        """
        plant = self._plant
        rates = posture.joints
        q = posture.q - plant.encoder_bias
        torque = self._arm.torques(q, rates.velocity, rates.acceleration)
        if plant.payload:
            torque += self._payload_torque(rates.velocity, rates.acceleration)

        torque += np.multiply(plant.friction, np.tanh(rates.velocity / FRICTION_WIDTH))
        torque += np.multiply(plant.damping, rates.velocity) + np.multiply(
            plant.cable, q
        )
        return torque

    def reading(self, posture: Posture, tick: int) -> Array:
        """Torque sensor readings (7,) [N m] in `posture`, with noise that `tick`
        determines.
        """
        plant = self._plant
        noise = np.random.default_rng((plant.seed, tick)).standard_normal(7)
        felt = self.torque(posture) * (1.0 + np.array(plant.torque_scale))
        return felt + plant.torque_bias + plant.torque_noise * noise

    def sag(self, posture: Posture) -> Array:
        """Elastic deflection (7,) [rad] of the links from their motors, which are in
        `posture`.
        """
        return np.multiply(self._plant.compliance, self.torque(posture))

    def _payload_torque(self, velocity: Array, acceleration: Array) -> Array:
        """Joint torques (7,) [N m] that carry and accelerate the payload, a point mass,
        at joint `velocity` [rad/s] and `acceleration` [rad/s^2].
        """
        model = self._arm.model
        data = self._arm.data
        body = model.body("link7").id
        point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ self._payload_point
        jacobian = np.zeros((3, 7))
        rate = np.zeros((3, 7))
        mujoco.mj_jac(model, data, jacobian, None, point, body)
        mujoco.mj_jacDot(model, data, rate, None, point, body)
        specific_force = jacobian @ acceleration + rate @ velocity - model.opt.gravity
        torques: Array = self._plant.payload * jacobian.T @ specific_force
        return torques


class ReportedRates:
    """Velocities and accelerations of the commanded joints as the emulated robot
    reports them, in the manner `kind`.

    What a robot reports need not be the derivative of what it was commanded: FILTERED
    lags by FILTER_TIME, LATE is LATE_TICKS old, MEASURED is of the arm itself.
    """

    def __init__(self, kind: RateReport = RateReport.EXACT) -> None:
        self.kind = kind
        self._past = deque([zero_rates(7)], maxlen=LATE_TICKS + 1)
        self._filtered = zero_rates(7)
        self._measured = zero_rates(7)

    def tick(self, commanded: Rates, measured: Rates) -> None:
        """Advance by one tick of 1 ms, to the `commanded` joint rates and to those
        `measured` of the arm.
        """
        self._past.append(commanded)
        self._measured = measured
        gain = lag_gain(FILTER_TIME)
        last = self._filtered
        self._filtered = Rates(
            last.velocity + gain * (commanded.velocity - last.velocity),
            last.acceleration + gain * (commanded.acceleration - last.acceleration),
        )

    @property
    def rates(self) -> Rates:
        """Velocities and accelerations of the joints that the robot reports in this
        tick of 1 ms.
        """
        match self.kind:
            case RateReport.EXACT:
                return self._past[-1]
            case RateReport.FILTERED:
                return self._filtered
            case RateReport.LATE:
                return self._past[0]
            case RateReport.MEASURED:
                return self._measured
            case _:
                return zero_rates(7)


class LaggingArm:
    """Arm whose `posture` follows the commanded joints after `delay` [s] and with the
    first-order time constant `lag` [s].

    `sag` gives from the motors' posture the deflection (7,) [rad] to subtract from
    their joints.
    """

    def __init__(
        self,
        posture: Posture,
        tool: Array,
        delay: float,
        lag: float,
        sag: Sag | None,
    ) -> None:
        """Place the arm at rest in `posture`, with the tool's pose `tool` (4, 4) in the
        flange's frame.
        """
        self._tool = tool
        self._sag = sag
        self._lag_gain = lag_gain(lag)
        self._delayed = deque([posture.q] * (1 + round(delay / TICK)))
        self._motors = self.posture = posture
        if sag is not None:
            self.posture = Posture.resting(posture.q - sag(posture), tool)

    def tick(self, commanded: Array) -> None:
        """Advance the arm by one tick of 1 ms, in which the joints `commanded` (7,)
        [rad] are sent.
        """
        delayed = self._delayed
        delayed.append(commanded)
        delayed.popleft()
        motors = self._motors
        q = motors.q + self._lag_gain * (delayed[0] - motors.q)
        rates = self.posture.joints  # of the links, which come to rest after the motors
        if np.array_equal(q, motors.q) and not np.any(
            (rates.velocity, rates.acceleration)
        ):
            return

        self._motors = self._step(motors, q)
        if self._sag is None:
            self.posture = self._motors
        else:
            self.posture = self._step(self.posture, q - self._sag(self._motors))

    def _step(self, before: Posture, q: Array) -> Posture:
        """Posture at joints `q` (7,) [rad], one tick of 1 ms after `before`."""
        rates = before.joints.step((q - before.q) / TICK)
        return Posture.at_joints(q, self._tool, rates)


def _tilt(gravity: float, x: float, y: float) -> Array:
    """Components (3,) [m/s^2] of the vertical acceleration `gravity` in a base that
    leans by `x` about x, then by `y` [rad] about y.
    """
    upright = gravity * np.cos(x)
    return np.array([upright * np.sin(y), -gravity * np.sin(x), upright * np.cos(y)])
