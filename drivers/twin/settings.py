"""Settings of the twin: what its arm, hand and world are like."""

from typing import Self

from pydantic import Field, model_validator

from drivers.settings import Settings
from drivers.twin.camera_settings import CameraSettings


class ArmSettings(Settings):
    """The twin's arm. Lengths [m], angles [rad], times [s].

    It trails its commands by `lag` and measures itself with `noise` and `pitch_noise` (one
    sigma).
    """

    home_height: float = Field(0.15, ge=0.02, le=0.5)  # over the grasped edge, at rest
    lag: float = Field(0.004, ge=0, le=0.1)
    noise: float = Field(2e-5, ge=0, le=0.005)
    pitch_noise: float = Field(1e-4, ge=0, le=0.05)


class HandSettings(Settings):
    """The twin's hand. Lengths [m], angles [rad]."""

    opening: float = Field(0.04, ge=0.01, le=0.08)  # between open fingers
    speed: float = Field(0.08, gt=0, le=0.5)  # m/s, of the width
    reach: float = Field(0.005, gt=0, le=0.02)  # from gripper to edge for a grasp
    lean: float = Field(0.3, gt=0, le=1.0)  # between gripper and edge for a grasp


class WorldSettings(Settings):
    """The twin's desk and strip. Times [s]."""

    links: int = Field(60, ge=40, le=400)
    step: float = Field(0.005, ge=0.0005, le=0.005)
    memory: float = Field(1.0, ge=0.1, le=10.0)  # how far back the camera can look
    strip: bool = True  # whether one lies on the desk


class TwinSettings(Settings):
    """Everything that stands in for hardware."""

    arm: ArmSettings = ArmSettings()
    hand: HandSettings = HandSettings()
    world: WorldSettings = WorldSettings()
    camera: CameraSettings = CameraSettings()

    @model_validator(mode="after")
    def _exposure_is_simulated_when_it_arrives(self) -> Self:
        earliest = self.camera.exposure / 2 + self.world.step
        if self.camera.transport_delay < earliest:
            raise ValueError(
                f"camera.transport_delay {self.camera.transport_delay} s is over before the strip "
                f"has been simulated; allowed: at least exposure / 2 + world.step, {earliest} s"
            )
        return self
