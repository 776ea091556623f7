"""Numbers of perception, each with its origin."""

from pydantic import Field

from drivers.settings import Settings


class PerceptionSettings(Settings):
    """How images are read; lengths [m] in the cell frame unless a name says pixels."""

    contact_height: float = Field(0.001, gt=0, le=0.01)  # m above rest, the definition
    contact_bias: float = Field(0.0, ge=-0.02, le=0.02)  # m, measured minus true
    contrast: float = Field(30.0, gt=0, le=255)  # grey levels between strip and surroundings
    flatness: float = Field(0.003, gt=0, le=0.02)  # m, worst height of a flat strip
    length_tolerance: float = Field(0.006, gt=0, le=0.05)  # m, of the stated length
    profile_points: int = Field(150, ge=20, le=500)
    gripper_clearance: float = Field(0.004, ge=0, le=0.05)  # m that the fingers hide
    gap_opening: float = Field(0.012, gt=0, le=0.1)  # m from which layers count as apart
