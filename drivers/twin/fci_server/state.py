"""State of the emulated arm as the UDP datagram (1377 bytes) that the robot sends each
tick.
"""

import numpy as np

from drivers.base.types import GRAVITY, Array
from drivers.franka.inverse_kinematics import ELBOW_JOINT
from drivers.franka.model import HAND_INERTIA, ArmModel
from drivers.twin.fci_server.configuration import Configuration
from drivers.twin.fci_server.robot import EmulatedRobot
from drivers.twin.fci_server.wire import Controller, Generator, Reflex

PACKET = np.dtype(
    [
        ("message_id", "<u8"),
        ("O_T_EE", "<f4", 16),
        ("O_T_EE_d", "<f4", 16),
        ("F_T_EE", "<f4", 16),
        ("EE_T_K", "<f4", 16),
        ("F_T_NE", "<f4", 16),
        ("NE_T_EE", "<f4", 16),
        ("m_ee", "<f4", (1,)),
        ("I_ee", "<f4", 9),
        ("F_x_Cee", "<f4", 3),
        ("m_load", "<f4", (1,)),
        ("I_load", "<f4", 9),
        ("F_x_Cload", "<f4", 3),
        ("elbow", "<f4", 2),
        ("elbow_d", "<f4", 2),
        ("tau_J", "<f4", 7),
        ("tau_J_d", "<f4", 7),
        ("dtau_J", "<f4", 7),
        ("q", "<f4", 7),
        ("q_d", "<f4", 7),
        ("dq", "<f4", 7),
        ("dq_d", "<f4", 7),
        ("ddq_d", "<f4", 7),
        ("joint_contact", "<f4", 7),
        ("cartesian_contact", "<f4", 6),
        ("joint_collision", "<f4", 7),
        ("cartesian_collision", "<f4", 6),
        ("tau_ext_hat_filtered", "<f4", 7),
        ("O_F_ext_hat_K", "<f4", 6),
        ("K_F_ext_hat_K", "<f4", 6),
        ("O_dP_EE_d", "<f4", 6),
        ("O_ddP_O", "<f4", 3),
        ("elbow_c", "<f4", 2),
        ("delbow_c", "<f4", 2),
        ("ddelbow_c", "<f4", 2),
        ("O_T_EE_c", "<f4", 16),
        ("O_dP_EE_c", "<f4", 6),
        ("O_ddP_EE_c", "<f4", 6),
        ("theta", "<f4", 7),
        ("dtheta", "<f4", 7),
        ("accelerometers", "<f4", 36),
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
    """Serialiser of the emulated robot's state; gravity's torques are kept while joints
    rest.
    """

    def __init__(self) -> None:
        self._packet = np.zeros(1, PACKET)
        # views into the packet, by name: (n,) each
        self.fields = fields = {
            name: self._packet[name].reshape(-1) for name in PACKET.names or ()
        }
        fields["I_ee"][:] = np.diag(HAND_INERTIA).ravel()
        fields["O_ddP_O"][:] = (0.0, 0.0, -GRAVITY)
        self._model, self._modelled = ArmModel(), Configuration()
        # torques of gravity, and the joints for which they were computed
        self._gravity, self._gravity_q = np.zeros(7), np.full(7, np.inf)

    def datagram(self, robot: EmulatedRobot, rate: float = 0.0) -> bytes:
        """Datagram of `robot` after its last tick; `rate` is the fraction of commands
        in time.
        """
        self._put_configuration(robot.configuration)
        self._put_modes(robot)
        self._put_posture(robot)
        self._put_contact(robot)
        if robot.time < robot.sensors_fail_until:
            for name in MEASURED_FIELDS:
                self.fields[name][:] = np.nan
        self.fields["message_id"][0] = robot.time
        self.fields["success_rate"][0] = rate
        return self._packet.tobytes()

    def _put_matrix(self, name: str, matrix: Array) -> None:
        """Write a matrix (n, n) to the field `name` in column-major order."""
        self.fields[name][:] = matrix.T.ravel()

    def _put_configuration(self, configuration: Configuration) -> None:
        """Write tool, load and frames of `configuration` into the state's fields."""
        fields = self.fields
        self._put_matrix("F_T_EE", configuration.tool)
        self._put_matrix("F_T_NE", configuration.flange_to_nominal)
        self._put_matrix("NE_T_EE", configuration.nominal_to_tool)
        self._put_matrix("EE_T_K", configuration.tool_to_stiffness)
        fields["m_ee"][:] = configuration.hand_mass
        fields["F_x_Cee"][:] = configuration.hand_centre
        fields["m_load"][:] = configuration.load_mass
        fields["F_x_Cload"][:] = configuration.load_centre
        fields["I_load"][:] = configuration.load_inertia

    def _put_modes(self, robot: EmulatedRobot) -> None:
        """Write mode, generator, controller and error flags of `robot` into the state's
        fields.
        """
        motion = robot.motion
        fields = self.fields
        fields["generator"][0] = Generator.IDLE if motion is None else motion.generator
        fields["controller"][0] = (
            Controller.OTHER if motion is None else motion.controller
        )
        fields["mode"][0] = robot.mode
        for name, flags in (("errors", robot.errors), ("reasons", robot.reasons)):
            fields[name][:] = 0
            fields[name][list(flags)] = 1

    def _put_posture(self, robot: EmulatedRobot) -> None:
        """Write setpoints and measured joints of the robot into the packet."""
        posture = robot.posture
        arm = robot.measured
        fields = self.fields
        for name in ("O_T_EE_d", "O_T_EE_c"):
            self._put_matrix(name, posture.pose)
        fields["q_d"][:] = posture.q
        reported = robot.reported.rates
        fields["dq_d"][:] = reported.velocity
        fields["ddq_d"][:] = reported.acceleration
        fields["O_dP_EE_d"][:] = fields["O_dP_EE_c"][:] = posture.tool.velocity
        fields["O_ddP_EE_c"][:] = posture.tool.acceleration
        angle, rate, acceleration = posture.swing
        fields["delbow_c"][0] = rate
        fields["ddelbow_c"][0] = acceleration
        fields["elbow_d"][:] = fields["elbow_c"][:] = angle, posture.elbow_sign
        self._put_matrix("O_T_EE", arm.reached)  # below: the measured arm
        fields["q"][:] = fields["theta"][:] = arm.q
        fields["dq"][:] = fields["dtheta"][:] = arm.joints.velocity
        fields["elbow"][:] = arm.q[ELBOW_JOINT], arm.elbow_sign
        fields["tau_J"][:] = self._torques(robot) - robot.contact.torque

    def _torques(self, robot: EmulatedRobot) -> Array:
        """Joint torques (7,) [N m] without contact: of the plant, or else of gravity
        alone.
        """
        if robot.dynamics is not None:
            return robot.dynamics.reading(robot.measured, robot.ticks)
        model = self._model_of(robot.configuration)
        if np.abs(robot.measured.q - self._gravity_q).max() > TURNED:
            self._gravity_q = np.array(robot.measured.q)
            self._gravity = model.torques(robot.measured.q)
        return self._gravity

    def _model_of(self, tool: Configuration) -> ArmModel:
        """Model of the arm with hand and load as `tool` states them."""
        if self._modelled is not tool:
            mass = tool.hand_mass + tool.load_mass
            moment = (
                tool.hand_mass * tool.hand_centre + tool.load_mass * tool.load_centre
            )
            self._model, self._modelled = ArmModel(mass, moment / mass), tool
            self._gravity_q = np.full(7, np.inf)
        return self._model

    def _put_contact(self, robot: EmulatedRobot) -> None:
        """Write external wrench, torques and contact flags of `robot` into the state's
        fields.
        """
        fields, contact = self.fields, robot.contact
        fields["tau_ext_hat_filtered"][:] = contact.torque
        if robot.mistaken:
            arm = robot.measured.joints
            own = self._model_of(robot.configuration).torques(
                robot.measured.q, arm.velocity, arm.acceleration
            )
            fields["tau_ext_hat_filtered"][:] += robot.mistaken * own
        fields["O_F_ext_hat_K"][:] = contact.wrench
        turn = (
            robot.posture.reached[:3, :3]
            @ robot.configuration.tool_to_stiffness[:3, :3]
        )
        fields["K_F_ext_hat_K"][:3] = turn.T @ contact.wrench[:3]
        fields["K_F_ext_hat_K"][3:] = turn.T @ contact.wrench[3:]
        fields["joint_contact"][:], fields["joint_collision"][:] = contact.joint_flags
        fields["cartesian_contact"][:], fields["cartesian_collision"][:] = (
            contact.tool_flags
        )
