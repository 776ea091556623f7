"""The robot's state as a UDP datagram."""

import numpy as np

from drivers.fci_server.configuration import Configuration
from drivers.fci_server.contact import NO_CONTACT, Contact
from drivers.fci_server.robot import Robot
from drivers.fci_server.state_packet import StatePacket
from drivers.fci_server.wire import Controller, Generator
from drivers.franka.gravity import holding_torques
from drivers.franka.tracking import ELBOW_JOINT
from drivers.types import Array

HAND_INERTIA = (0.001, 0.0, 0.0, 0.0, 0.0025, 0.0, 0.0, 0.0, 0.0017)  # kg m^2
MEASURED_FIELDS = ("q", "dq", "O_T_EE", "O_F_ext_hat_K", "K_F_ext_hat_K", "tau_ext_hat_filtered")
TURNED = 5e-3  # rad by which a joint turns before the torques of gravity are computed again


class Publisher:
    """Serialises the robot's state; keeps rarely changing fields between datagrams."""

    def __init__(self) -> None:
        self._packet = StatePacket()
        fields = self._packet.fields
        fields["I_ee"][:] = HAND_INERTIA
        fields["O_ddP_O"][:] = (0.0, 0.0, -9.81)
        self._configuration: Configuration | None = None
        self._errors: object = None
        self._contact: Contact | None = None
        # torques of gravity, and the configuration and joints for which they were computed
        self._gravity, self._gravity_q = np.zeros(7), np.zeros(7)
        self._gravity_configuration: Configuration | None = None

    def datagram(self, robot: Robot, rate: float = 0.0, is_nan: bool = False) -> bytes:
        """State after the last tick; `rate` is the fraction of commands that arrived in time.

        With `is_nan` its measured part is NaN, as from a broken sensor.
        """
        if robot.configuration is not self._configuration:
            self._put_configuration(robot.configuration)
        self._put_modes(robot)
        self._put_posture(robot)
        if robot.contact is not self._contact or robot.contact is not NO_CONTACT or is_nan:
            self._put_contact(robot)
        if is_nan:
            for name in MEASURED_FIELDS:
                self._packet.fields[name][:] = np.nan
            self._contact = None
        return self._packet.seal(robot.time, rate)

    def _put_configuration(self, configuration: Configuration) -> None:
        packet = self._packet
        packet.put_matrix("F_T_EE", configuration.tool)
        packet.put_matrix("F_T_NE", configuration.flange_to_nominal)
        packet.put_matrix("NE_T_EE", configuration.nominal_to_tool)
        packet.put_matrix("EE_T_K", configuration.tool_to_stiffness)
        packet.fields["m_ee"][:] = configuration.hand_mass
        packet.fields["F_x_Cee"][:] = configuration.hand_centre
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
        """Write setpoints and measured joints of the robot into the packet."""
        posture, arm, fields = robot.posture, robot.measured, self._packet.fields
        for name in ("O_T_EE_d", "O_T_EE_c"):
            self._packet.put_matrix(name, posture.pose)
        fields["q_d"][:], fields["dq_d"][:] = posture.q, posture.joints.velocity
        fields["ddq_d"][:] = posture.joints.acceleration
        fields["O_dP_EE_d"][:] = fields["O_dP_EE_c"][:] = posture.tool.velocity
        fields["O_ddP_EE_c"][:] = posture.tool.acceleration
        angle, rate, acceleration = posture.swing
        fields["delbow_c"][0], fields["ddelbow_c"][0] = rate, acceleration
        fields["elbow_d"][:] = fields["elbow_c"][:] = angle, posture.elbow_sign
        self._packet.put_matrix("O_T_EE", arm.reached)  # from here on what the arm itself does
        fields["q"][:] = fields["theta"][:] = arm.q
        fields["dq"][:] = fields["dtheta"][:] = arm.joints.velocity
        fields["elbow"][:] = arm.q[ELBOW_JOINT], arm.elbow_sign
        fields["tau_J"][:] = self._torques(robot) - robot.contact.torque

    def _torques(self, robot: Robot) -> Array:
        """Joint torques (7,) [N m] without contact: of the plant, or else of gravity alone."""
        if robot.dynamics is not None:
            return robot.dynamics.reading(robot.measured, robot.ticks)
        q, tool = robot.measured.q, robot.configuration
        is_known = self._gravity_configuration is tool
        if not is_known or np.abs(q - self._gravity_q).max() > TURNED:
            self._gravity_q, self._gravity_configuration = np.array(q), tool
            mass = tool.hand_mass + tool.load_mass
            moment = tool.hand_mass * tool.hand_centre + tool.load_mass * tool.load_centre
            self._gravity = holding_torques(q, mass, moment / mass)
        return self._gravity

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
