"""The robot's state as a UDP datagram."""

import numpy as np

from drivers.twin.server.configuration import Configuration
from drivers.twin.server.contact import NOTHING, Contact
from drivers.twin.server.robot import Robot
from drivers.twin.server.state_packet import StatePacket
from drivers.twin.server.wire import Controller, Generator

HAND_MASS = 0.73  # kg, Franka Hand
HAND_CENTRE = (-0.01, 0.0, 0.03)  # m in the flange
HAND_INERTIA = (0.001, 0.0, 0.0, 0.0, 0.0025, 0.0, 0.0, 0.0, 0.0017)  # kg m^2
MEASURED = ("q", "dq", "O_T_EE", "O_F_ext_hat_K", "K_F_ext_hat_K", "tau_ext_hat_filtered")


class Publisher:
    """Serialises the robot's state; keeps rarely changing fields between datagrams."""

    def __init__(self) -> None:
        self._packet = StatePacket()
        fields = self._packet.fields
        fields["m_ee"][:] = HAND_MASS
        fields["F_x_Cee"][:] = HAND_CENTRE
        fields["I_ee"][:] = HAND_INERTIA
        fields["O_ddP_O"][:] = (0.0, 0.0, -9.81)
        self._configuration: Configuration | None = None
        self._errors: object = None
        self._contact: Contact | None = None

    def datagram(self, robot: Robot, rate: float = 0.0, is_nan: bool = False) -> bytes:
        """State after the last tick; `rate` is the fraction of commands that arrived in time.

        With `is_nan` its measured part is NaN, as from a broken sensor.
        """
        if robot.configuration is not self._configuration:
            self._put_configuration(robot.configuration)
        self._put_modes(robot)
        self._put_posture(robot)
        if robot.contact is not self._contact or robot.contact is not NOTHING or is_nan:
            self._put_contact(robot)
        if is_nan:
            for name in MEASURED:
                self._packet.fields[name][:] = np.nan
            self._contact = None
        return self._packet.sealed(robot.time, rate)

    def _put_configuration(self, configuration: Configuration) -> None:
        packet = self._packet
        packet.put_matrix("F_T_EE", configuration.tool)
        packet.put_matrix("F_T_NE", configuration.flange_to_nominal)
        packet.put_matrix("NE_T_EE", configuration.nominal_to_tool)
        packet.put_matrix("EE_T_K", configuration.tool_to_stiffness)
        packet.fields["m_load"][:] = configuration.load_mass
        packet.fields["F_x_Cload"][:] = configuration.load_centre
        packet.fields["I_load"][:] = configuration.load_inertia
        self._configuration = configuration

    def _put_modes(self, robot: Robot) -> None:
        motion = robot.motion
        generator = Generator.IDLE if motion is None else motion.generator
        controller = Controller.OTHER if motion is None else motion.controller
        self._packet.put_modes(generator, controller, robot.mode)
        if self._errors != (robot.errors, robot.reasons):
            self._packet.put_errors(robot.errors, robot.reasons)
            self._errors = (robot.errors, robot.reasons)

    def _put_posture(self, robot: Robot) -> None:
        packet, fields, posture = self._packet, self._packet.fields, robot.posture
        packet.put_matrix("O_T_EE", posture.reached)
        packet.put_matrix("O_T_EE_d", posture.pose)
        fields["O_T_EE_c"][:] = fields["O_T_EE_d"]
        for name in ("q", "q_d", "theta"):
            fields[name][:] = posture.q
        for name in ("dq", "dq_d", "dtheta"):
            fields[name][:] = posture.joints.velocity
        fields["ddq_d"][:] = posture.joints.acceleration
        for name in ("O_dP_EE_d", "O_dP_EE_c"):
            fields[name][:] = posture.tool.velocity
        fields["O_ddP_EE_c"][:] = posture.tool.acceleration
        angle, sign = posture.elbow, posture.elbow_sign
        fields["elbow"][:] = posture.q[2], sign
        for name in ("elbow_d", "elbow_c"):
            fields[name][:] = angle, sign
        fields["delbow_c"][0] = posture.swing.velocity[0]
        fields["ddelbow_c"][0] = posture.swing.acceleration[0]

    def _put_contact(self, robot: Robot) -> None:
        fields, contact = self._packet.fields, robot.contact
        self._contact = contact
        fields["tau_ext_hat_filtered"][:] = contact.torque
        fields["O_F_ext_hat_K"][:] = contact.wrench
        turn = robot.posture.reached[:3, :3] @ robot.configuration.tool_to_stiffness[:3, :3]
        fields["K_F_ext_hat_K"][:3] = turn.T @ contact.wrench[:3]
        fields["K_F_ext_hat_K"][3:] = turn.T @ contact.wrench[3:]
        fields["joint_contact"][:], fields["joint_collision"][:] = contact.joint_flags
        fields["cartesian_contact"][:], fields["cartesian_collision"][:] = contact.tool_flags
