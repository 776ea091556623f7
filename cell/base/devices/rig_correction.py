"""Compensation of known errors of the rig, such as a wrong height of the desk or an
offset of the tool.
"""

from dataclasses import replace

import numpy as np

from calibration.calibration import Calibration, change_calibration
from calibration.homography import Homography
from cell.base.config.cell import CellFile
from cell.base.devices.devices import ArmHistory, Devices
from drivers.base.geometry import lengths
from drivers.base.protocols import Arm, Hand
from drivers.base.types import ArmState, Array, Pose, Velocity
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.model import ObservationModel, Rig, StripModel
from drivers.strip.observation import (
    LIFT_TRAVEL,
    GrowingOffsets,
    reported_poses,
    true_points,
    true_poses,
)


def corrected_calibration(
    calibration: Calibration, settings: CellFile, strip: StripFile
) -> Calibration:
    """Copy of `calibration` that compensates the effects of camera and desk that
    cell.yaml states.

    Points lie on the true desk, stamps are true times. Without such effects the same
    object is returned; with some, a calibration with an id of its own and without
    landmarks, which are valid only for the uncorrected one.
    """
    model = describe(strip, settings.effects)
    observation = model.observation
    if observation == ObservationModel() and model.rig.desk_height == 0:
        return calibration
    homography = _measured_to_true(model) @ calibration.homography.matrix
    # the bias is of measured lengths, each 1 + scale times the true one
    true_bias = observation.contact_bias / (1.0 + observation.scale)
    return change_calibration(
        calibration,
        homography=Homography.from_matrix(homography),
        landmarks=None,
        latency=calibration.latency + observation.camera_latency,
        contact_bias=calibration.contact_bias + true_bias,
    )


def _measured_to_true(model: StripModel) -> Array:
    """Homography (3, 3) that takes measured points x, z [m] of the strip's plane to the
    true ones.
    """
    origin, x, z = true_points(model, np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]))
    return np.array([[*(x - origin), 0.0], [*(z - origin), 0.0], [*origin, 1.0]]).T


def corrected_devices(
    devices: Devices, settings: CellFile, strip: StripFile
) -> Devices:
    """Copy of `devices` whose arm reports true poses, as the effects of the rig that
    cell.yaml states are compensated.
    """
    rig = describe(strip, settings.effects).rig
    if rig == Rig():
        return devices
    return replace(devices, arm=CorrectedArm(devices.arm, devices.hand, rig))


class CorrectedArm:
    """Arm that wraps another arm and compensates the known errors `rig` of its reported
    poses.

    States give the gripper's true pose over the true desk at their stamp; commanded
    poses are true ones. As in `drivers.strip.observation`, offsets grow from where
    `hand` first holds the strip.
    """

    def __init__(self, arm: Arm, hand: Hand, rig: Rig) -> None:
        self._arm = arm
        self._hand = hand
        self._rig = rig
        self._reports = ArmHistory()
        self._offsets = GrowingOffsets(rig)
        self._reported = np.zeros(3)

    def connect(self) -> None:
        """Connect the arm and hold it at rest."""
        self._arm.connect()

    def state(self) -> ArmState:
        """Newest measured state of the arm, with the true pose of the gripper in place
        of the reported one.
        """
        measured = self._arm.state()
        true_pose = self._advance_offsets(measured)
        return replace(
            measured,
            pose=Pose.from_array(true_pose),
            velocity=_sum(measured.velocity, self._offset_velocity(measured.velocity)),
            commanded=Pose.from_array(
                self._offsets.true(measured.commanded.as_array())
            ),
        )

    def move_to(self, pose: Pose) -> None:
        """Begin a motion of the gripper to rest at the true `pose`."""
        reported = reported_poses(self._rig, pose.as_array(), self._offsets.fraction)
        self._arm.move_to(Pose.from_array(reported))

    def set_velocity(self, velocity: Velocity) -> None:
        """Follow the true `velocity` of the gripper from now on."""
        self._arm.set_velocity(_sum(velocity, -self._offset_velocity(velocity)))

    def stop(self) -> None:
        """Brake the arm within its limits; allowed at any time, from any state."""
        self._arm.stop()

    def close(self) -> None:
        """Brake the arm and disconnect; calling it twice is allowed."""
        self._arm.close()

    def _advance_offsets(self, measured: ArmState) -> Array:
        """True pose (3,) [m, m, rad] of the arm in the state `measured`, with offsets
        that grow from the grasp on.
        """
        self._reports.add(measured)
        self._reported = self._at_stamp(measured)
        if self._offsets.start is None and self._hand.state().grasped:
            self._offsets.start = self._reported
        return self._offsets.advance(self._reported)

    def _at_stamp(self, measured: ArmState) -> Array:
        """Reported pose (3,) [m, m, rad] that belongs to the stamp of `measured`, as
        reports come with a known delay.

        What the arm reports at t was true at t - delay. The future is extrapolated at
        the measured velocity.
        """
        ahead = self._rig.delay
        if ahead == 0:
            return measured.pose.as_array()
        if ahead > 0:
            rate = measured.velocity
            travel = ahead * np.array([rate.vx, rate.vz, rate.pitch_rate])
            return np.asarray(measured.pose.as_array() + travel)
        return self._reports.pose_at(measured.stamp + ahead).as_array()

    def _offset_velocity(self, rate: Velocity) -> Array:
        """Velocity (3,) [m/s, m/s, rad/s] at which the rig's offsets change as the arm
        moves at `rate`.
        """
        start = self._offsets.start
        if start is None or not 0 < self._offsets.fraction < 1:
            return np.zeros(3)
        path = (self._reported - start)[:2]
        outward = float(path @ (rate.vx, rate.vz)) / max(float(lengths(path)), 1e-9)
        full = true_poses(self._rig, np.zeros(3), 1.0)
        return np.asarray(full * max(outward, 0.0) / LIFT_TRAVEL)


def _sum(velocity: Velocity, more: Array) -> Velocity:
    """Sum of `velocity` and `more` (3,): x and z [m/s], pitch [rad/s]."""
    x, z, pitch = more.tolist()
    return Velocity(velocity.vx + x, velocity.vz + z, velocity.pitch_rate + pitch)
