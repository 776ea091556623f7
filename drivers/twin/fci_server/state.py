"""State of the emulated arm as the UDP datagram (1377 bytes) that the robot sends each
tick.
"""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from drivers.base.readers import read_yaml
from drivers.base.types import GRAVITY, Array
from drivers.franka.inverse_kinematics import ELBOW_JOINT
from drivers.franka.model import HAND_INERTIA, ArmModel
from drivers.twin.fci_server.configuration import Configuration
from drivers.twin.fci_server.robot import EmulatedRobot
from drivers.twin.fci_server.wire import Controller, Generator, Reflex

FLOATS = read_yaml(Path(__file__).with_suffix(".yaml"))  # counts, by field
PACKET = np.dtype(
    [
        ("message_id", "<u8"),
        *((name, "<f4", (count,)) for name, count in FLOATS.items()),
        ("generator", "u1"),
        ("controller", "u1"),
        ("errors", "u1", len(Reflex)),
        ("reasons", "u1", len(Reflex)),
        ("mode", "u1"),
        ("success_rate", "<f4"),
    ]
)
MEASURED_FIELDS = (
    "q",
    "dq",
    "O_T_EE",
    "O_F_ext_hat_K",
    "K_F_ext_hat_K",
    "tau_ext_hat_filtered",
)
# rad by which a joint turns before the torques of gravity are computed again
TURNED = 5e-3


class Publisher:
    """Writer of the emulated robot's state as a datagram; it keeps the torques of
    gravity while the joints rest.
    """

    def __init__(self) -> None:
        self._packet = np.zeros(1, PACKET)
        # views into the packet, by name: (n,) each
        self.fields = {
            name: self._packet[name].reshape(-1) for name in PACKET.names or ()
        }
        self._put(I_ee=_columns(np.diag(HAND_INERTIA)), O_ddP_O=(0.0, 0.0, -GRAVITY))
        self._model = ArmModel()
        self._modelled = Configuration()
        # torques of gravity, and the joints for which they were computed
        self._gravity = np.zeros(7)
        self._gravity_q = np.full(7, np.inf)

    def _put(self, **values: ArrayLike) -> None:
        """Write each of `values` into the field of the state that has its name."""
        for name, value in values.items():
            self.fields[name][:] = value

    def datagram(self, robot: EmulatedRobot, rate: float = 0.0) -> bytes:
        """Bytes of the state of `robot` after its last tick of 1 ms; `rate` is the
        fraction of commands that arrived in time.
        """
        self._put_configuration(robot.configuration)
        self._put_modes(robot)
        self._put_posture(robot)
        self._put_contact(robot)
        if robot.time < robot.sensors_fail_until:
            for name in MEASURED_FIELDS:
                self.fields[name][:] = np.nan
        self._put(message_id=robot.time, success_rate=rate)
        return self._packet.tobytes()

    def _put_configuration(self, configuration: Configuration) -> None:
        """Write tool, load and frames of `configuration` into the state's fields."""
        self._put(
            F_T_EE=_columns(configuration.tool),
            F_T_NE=_columns(configuration.flange_to_nominal),
            NE_T_EE=_columns(configuration.nominal_to_tool),
            EE_T_K=_columns(configuration.tool_to_stiffness),
            m_ee=configuration.hand_mass,
            F_x_Cee=configuration.hand_centre,
            m_load=configuration.load_mass,
            F_x_Cload=configuration.load_centre,
            I_load=configuration.load_inertia,
        )

    def _put_modes(self, robot: EmulatedRobot) -> None:
        """Write mode, generator, controller and error flags of `robot` into the state's
        fields.
        """
        motion = robot.motion
        self._put(
            generator=Generator.IDLE if motion is None else motion.generator,
            controller=Controller.OTHER if motion is None else motion.controller,
            mode=robot.mode,
            errors=[reflex in robot.errors for reflex in Reflex],
            reasons=[reflex in robot.reasons for reflex in Reflex],
        )

    def _put_posture(self, robot: EmulatedRobot) -> None:
        """Write the commanded and the measured joints and poses of `robot` into the
        state's fields.
        """
        posture = robot.posture
        arm = robot.measured
        pose = posture.pose
        twist = posture.tool.velocity
        velocity = arm.joints.velocity
        reported = robot.reported.rates
        angle, rate, acceleration = posture.swing
        elbow = angle, posture.elbow_sign
        self._put(
            O_T_EE_d=_columns(pose),
            O_T_EE_c=_columns(pose),
            q_d=posture.q,
            dq_d=reported.velocity,
            ddq_d=reported.acceleration,
            O_dP_EE_d=twist,
            O_dP_EE_c=twist,
            O_ddP_EE_c=posture.tool.acceleration,
            elbow_d=elbow,
            elbow_c=elbow,
            delbow_c=(rate, 0.0),
            ddelbow_c=(acceleration, 0.0),
            O_T_EE=_columns(arm.reached),
            q=arm.q,
            theta=arm.q,
            dq=velocity,
            dtheta=velocity,
            elbow=(arm.q[ELBOW_JOINT], arm.elbow_sign),
            tau_J=self._torques(robot) - robot.contact.torque,
        )

    def _torques(self, robot: EmulatedRobot) -> Array:
        """Joint torques (7,) [N m] of `robot` without contact: those of its `dynamics`,
        or else of gravity alone.
        """
        if robot.dynamics is not None:
            return robot.dynamics.reading(robot.measured, robot.ticks)
        model = self._model_of(robot.configuration)
        if np.abs(robot.measured.q - self._gravity_q).max() > TURNED:
            self._gravity_q = np.array(robot.measured.q)
            self._gravity = model.torques(robot.measured.q)
        return self._gravity

    def _model_of(self, tool: Configuration) -> ArmModel:
        """Model of the arm that carries the hand and the load of the configuration
        `tool`.
        """
        if self._modelled is not tool:
            mass = tool.hand_mass + tool.load_mass
            moment = (
                tool.hand_mass * tool.hand_centre + tool.load_mass * tool.load_centre
            )
            self._model = ArmModel(mass, moment / mass)
            self._modelled = tool
            self._gravity_q = np.full(7, np.inf)
        return self._model

    def _put_contact(self, robot: EmulatedRobot) -> None:
        """Write external wrench, torques and contact flags of `robot` into the state's
        fields.
        """
        contact = robot.contact
        torque = contact.torque
        if robot.mistaken:
            arm = robot.measured.joints
            own = self._model_of(robot.configuration).torques(
                robot.measured.q, arm.velocity, arm.acceleration
            )
            torque = torque + robot.mistaken * own

        turn = (
            robot.posture.reached[:3, :3]
            @ robot.configuration.tool_to_stiffness[:3, :3]
        )
        joint_contact, joint_collision = contact.joint_flags
        tool_contact, tool_collision = contact.tool_flags
        self._put(
            tau_ext_hat_filtered=torque,
            O_F_ext_hat_K=contact.wrench,
            K_F_ext_hat_K=[*turn.T @ contact.wrench[:3], *turn.T @ contact.wrench[3:]],
            joint_contact=joint_contact,
            joint_collision=joint_collision,
            cartesian_contact=tool_contact,
            cartesian_collision=tool_collision,
        )


def _columns(matrix: Array) -> Array:
    """Numbers of a square `matrix` as a flat array in column-major order."""
    return matrix.T.ravel()
