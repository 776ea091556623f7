"""Settings of perception with their units and ranges."""

from pydantic import Field

from drivers.settings import Settings


class PerceptionSettings(Settings):
    """Settings of strip measurement in images; lengths [m] in the cell frame, px where marked."""

    contact_height: float = Field(0.001, gt=0, le=0.01)  # m above rest, the definition
    # m, measured minus true: what blur and shadow leave, the mean over ten strips and their
    # triangular folds on the twin (`python -m tests.lab study perception`)
    contact_bias: float = Field(0.0003, ge=-0.02, le=0.02)
    contrast: float = Field(30.0, gt=0, le=255)  # grey levels between strip and surroundings
    separation: float = Field(4.0, gt=0, le=20)  # of their colours, standard deviations
    flatness: float = Field(0.003, gt=0, le=0.02)  # m, worst height of a flat strip
    level: float = Field(0.0015, gt=0, le=0.02)  # m, by which it may lie off z = 0
    length_tolerance: float = Field(0.006, gt=0, le=0.05)  # m, of the stated length
    faint: float = Field(0.12, gt=0, lt=0.5)  # share of strip that an edge-on strip still shows
    shadow_height: float = Field(0.006, ge=0, le=0.05)  # m below which it casts a visible shadow
    outline_step: int = Field(3, ge=1, le=10)  # px between points along the outline
    spacing: float = Field(0.002, gt=0, le=0.01)  # m over which the midline is averaged
    profile_points: int = Field(150, ge=20, le=500)
    little: float = Field(0.03, ge=0, le=0.1)  # m of lifted strip from which its profile counts
    length_error: float = Field(0.015, gt=0, le=0.1)  # m; twice that from the stated: unbelievable
    reach: float = Field(0.02, gt=0, le=0.1)  # m from the gripper where its profile may end
    gripper_clearance: float = Field(0.004, ge=0, le=0.05)  # m that the fingers hide
    gap_opening: float = Field(0.004, gt=0, le=0.1)  # m from which layers count as apart
    touch_margin: float = Field(0.0006, ge=0, le=0.01)  # m over the touching distance: noise
    touch_stop: float = Field(0.3, gt=0, lt=1)  # of the closing speed: slower has stopped
    touch_agreement: float = Field(0.05, gt=0, le=1)  # s by which the two signals may differ
    touch_frames: int = Field(40, ge=8, le=400)  # that are remembered
