"""Strip files: the properties of a fabric strip, as an operator states them."""

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from drivers.base.settings import Metres, Seconds, Settings, Unit, VersionedFile
from drivers.base.types import GRAVITY

PAPER_LINEAR_DENSITY = 1.65  # kg/m, spheres of 3.3 g every 2 mm (paper, appendix)
PAPER_SPACING = 0.002  # m

ArealDensity = Annotated[float, Unit("kg/m^2")]
Channel = Annotated[int, Field(ge=0, le=255)]
Colour = tuple[Channel, Channel, Channel]  # sRGB


class Provenance(Settings):
    """Published source of one value in a strip file; `assumed` where none is
    published.
    """

    key: str
    source: str
    note: str = ""


class StripFile(VersionedFile):
    """Contents of a strip file: size, mass, bending and effects of a fabric strip, in
    SI units.

    `law` holds amounts of generic laws that describe what no effect explains; written
    only where not empty.
    """

    kind: Literal["strip"] = "strip"
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    length: Metres = Field(ge=0.1, le=2.0)  # fixed edge to grasped edge
    width: Metres = Field(ge=0.001, le=1.0)
    # the paper's spheres make 33
    areal_density: ArealDensity = Field(ge=0.001, le=50.0)
    bending_length: Metres = Field(ge=0.002, le=0.2)  # (B / areal weight)^(1/3)
    retardation_time: Seconds = Field(ge=0, le=10.0)  # Kelvin-Voigt
    thickness: Metres = Field(0.001, ge=1e-6, le=0.02)
    colour: Colour = (128, 128, 128)
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)
    law: dict[str, float] = Field(default_factory=dict, exclude_if=lambda law: not law)
    spread: dict[str, tuple[float, float]] = Field(default_factory=dict)
    provenance: tuple[Provenance, ...] = ()

    @field_validator("spread")
    @classmethod
    def _check_spread(
        cls, spread: dict[str, tuple[float, float]]
    ) -> dict[str, tuple[float, float]]:
        """Validate `spread`: raises ValueError for a key that cannot have a range, or
        bounds that are not 0 < low <= high.
        """
        known = {"bending_length", "retardation_time", "areal_density", "thickness"}
        for key, (low, high) in spread.items():
            if key not in known:
                raise ValueError(
                    f"{key} cannot be spread; allowed: {', '.join(sorted(known))}"
                )
            if not 0 < low <= high:
                raise ValueError(f"{key} needs 0 < low <= high, found [{low}, {high}]")
        return spread

    @property
    def linear_density(self) -> float:
        """Mass per length of the strip [kg/m]."""
        return self.areal_density * self.width

    @property
    def mass(self) -> float:
        """Mass of the strip [kg]."""
        return self.linear_density * self.length

    @property
    def weight(self) -> float:
        """Weight of the strip [N]."""
        return self.linear_density * GRAVITY * self.length

    @property
    def rigidity(self) -> float:
        """Bending rigidity EI [N m^2]: bending length^3 times weight per length."""
        return self.bending_length**3 * self.linear_density * GRAVITY


def paper_strip(k: float, b: float, **changes: Any) -> StripFile:
    """Strip of Petrik and Kyrki (2019) of joint stiffness `k` [N m/rad], damping `b` [N
    m s/rad].

    Spheres of 3.3 g every 2 mm: c = (k ds / w)^(1/3), retardation time = b / k.
    """
    content: dict[str, Any] = {
        "schema": 1,
        "name": "paper",
        "length": 0.6,
        "width": 0.05,
        "areal_density": PAPER_LINEAR_DENSITY / 0.05,
        "bending_length": (
            (k * PAPER_SPACING / (PAPER_LINEAR_DENSITY * GRAVITY)) ** (1 / 3)
        ),
        "retardation_time": b / k,
    }
    return StripFile.model_validate(content | changes)


def paper_damping_minimum(k: float) -> float:
    """Smallest joint damping [N m s/rad] that Petrik and Kyrki (2019) use at stiffness
    `k`.
    """
    return 3e-3 * k + 3.5e-4
