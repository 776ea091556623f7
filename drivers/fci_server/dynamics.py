"""Joint torques of an emulated arm, and the deflection that they cause in its joints."""

import mujoco
import numpy as np

from drivers.arm_plant import ArmPlant
from drivers.fci_server.posture import Posture
from drivers.franka.dynamics import arm_mjcf
from drivers.franka.kinematics import FLANGE
from drivers.types import Array

FRICTION_WIDTH = 0.005  # rad/s over which dry friction changes sign


class Dynamics:
    """Inverse dynamics of the arm's published model, with the additional mechanics of a `plant`."""

    def __init__(self, plant: ArmPlant) -> None:
        """Build the model with mass errors and tilt of `plant`; the hand keeps the model's mass."""
        self._plant = plant
        model = mujoco.MjModel.from_xml_string(arm_mjcf())
        for i in range(7):
            heavier = 1.0 + plant.mass_error[i]
            model.body(f"link{i + 1}").mass *= heavier
            model.body(f"link{i + 1}").inertia *= heavier
        model.opt.gravity[:] = _tilt(float(model.opt.gravity[2]), *plant.tilt)
        self._model, self._data = model, mujoco.MjData(model)
        self._read: tuple[Posture, int, Array] | None = None  # last reading: at rest it stays
        self._tool = np.add(plant.payload_at, (0.0, 0.0, FLANGE))

    def torque(self, posture: Posture) -> Array:
        """Torques (7,) [N m] that the joints of the moving arm exert."""
        plant, data, course = self._plant, self._data, posture.joints
        q = posture.q - plant.encoder_bias
        data.qpos[:], data.qvel[:], data.qacc[:] = q, course.velocity, course.acceleration
        mujoco.mj_inverse(self._model, data)
        torque = np.array(data.qfrc_inverse)
        if plant.payload:
            torque += self._payload_torque(course.velocity, course.acceleration)
        torque += np.multiply(plant.friction, np.tanh(course.velocity / FRICTION_WIDTH))
        torque += np.multiply(plant.damping, course.velocity) + np.multiply(plant.cable, q)
        return np.asarray(torque)

    def reading(self, posture: Posture, tick: int) -> Array:
        """Torque sensor readings (7,) [N m] at a `tick`, which determines their noise."""
        last = self._read
        if last is not None and last[0] is posture and last[1] == tick:
            return last[2]
        plant = self._plant
        noise = np.random.default_rng((plant.seed, tick)).standard_normal(7)
        felt = self.torque(posture) * (1.0 + np.array(plant.torque_scale))
        found = np.asarray(felt + plant.torque_bias + plant.torque_noise * noise)
        self._read = (posture, tick, found)
        return found

    def sag(self, posture: Posture) -> Array:
        """Deflection (7,) [rad] of the links behind their motors, which are in `posture`."""
        return np.asarray(np.multiply(self._plant.compliance, self.torque(posture)))

    @property
    def bends(self) -> bool:
        """Whether any joint is elastic, so that its link deflects from its motor."""
        return any(self._plant.compliance)

    def _payload_torque(self, velocity: Array, acceleration: Array) -> Array:
        """Torques (7,) [N m] of the payload: J' m (J ddq + dJ dq - g) of a point."""
        model, data = self._model, self._data
        body = model.body("link7").id
        point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ self._tool
        jacobian, rate = np.zeros((3, 7)), np.zeros((3, 7))
        mujoco.mj_jac(model, data, jacobian, None, point, body)
        mujoco.mj_jacDot(model, data, rate, None, point, body)
        pull = jacobian @ acceleration + rate @ velocity - model.opt.gravity
        return np.asarray(self._plant.payload * jacobian.T @ pull)


def _tilt(gravity: float, x: float, y: float) -> tuple[float, float, float]:
    """Vertical `gravity` [m/s^2] in a base that leans by `x` [rad] about x, then `y` about y."""
    about_x = gravity * np.array([0.0, -np.sin(x), np.cos(x)])
    return about_x[2] * np.sin(y), about_x[1], about_x[2] * np.cos(y)
