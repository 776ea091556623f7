"""Settings of a fold: rates, speeds, heights."""

from typing import Literal

from pydantic import Field

from drivers.settings import Metres, Seconds, Settings, Speed
from policies.path import TAKEOVER_HEIGHT


class FoldSettings(Settings):
    """Parameters of a fold; lengths [m], speeds [m/s], times [s]."""

    control_rate: float = Field(100.0, ge=100, le=200)  # Hz; records promise 100 rows a second
    speed: Speed = Field(
        0.10, ge=0.005, le=0.16
    )  # on the path; faster, the lift out-turns the hand
    lay_speed: Speed = Field(0.10, ge=0.005, le=0.16)
    lay_height: Metres = Field(0.025, ge=0.005, le=0.06)  # of the edge above its place
    lay_beyond: Metres = Field(0.008, ge=0, le=0.02)  # past a taut edge; folds roll 6 mm
    takeover_height: Metres = Field(TAKEOVER_HEIGHT, ge=0.03, le=0.2)  # where the policy takes over
    start: Literal["flat", "hanging"] | None = None  # of measured time; None: by the arm
    longest_rest: Seconds = Field(4.0, ge=0.5, le=20.0)  # that a hanging strip is waited for
    approach: Metres = Field(0.05, ge=0.02, le=0.2)  # free way before the edge is grasped
    clear_height: Metres = Field(0.25, ge=0.1, le=0.4)  # of the gripper while the strip is judged
    stop_timeout: Seconds = Field(1.0, ge=0.2, le=5.0)  # to come to rest after a fault
