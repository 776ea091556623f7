"""Pendulum files: properties of a chain of hinged links as its maker states them."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Metres, Settings, Unit
from drivers.strip.file import Provenance

Length = Annotated[Metres, Field(ge=1e-4, le=100.0)]
Mass = Annotated[float, Unit("kg"), Field(ge=1e-6, le=1e5)]
Inertia = Annotated[float, Unit("kg m^2"), Field(ge=1e-14, le=1e8)]
Damping = Annotated[float, Unit("N m s"), Field(ge=0.0, le=1e6)]


class Link(Settings):
    """Link of a pendulum: mass [kg], length to the next joint [m], com from its joint [m].

    Inertia [kg m^2] is about the centre of mass, damping [N m s] is viscous, of the link's joint.
    """

    mass: Mass
    length: Length | None
    com: Length
    inertia: Inertia
    damping: Damping


class PendulumFile(Settings):
    """Content of a pendulum file, as its contract describes: gravity [m/s^2], links, effects."""

    schema_: Literal[1] = Field(1, alias="schema")
    kind: Literal["pendulum"]
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    gravity: float = Field(ge=1.0, le=30.0)
    links: tuple[Link, ...] = Field(min_length=1, max_length=6)
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)
    provenance: tuple[Provenance, ...] = ()

    @model_validator(mode="after")
    def _lengths(self) -> Self:
        *inner, last = self.links
        if any(link.length is None for link in inner):
            raise ValueError("only the last link may have no length")
        if last.length is not None and last.com > 10.0 * last.length:
            raise ValueError("the last link's com lies far beyond its end")
        return self

    def xml(self) -> str:
        """MJCF text of the chain, hanging at zero; its bodies and joints are called 1, 2, 3, ..."""
        opened, above = "", 0.0
        for i, link in enumerate(self.links, start=1):
            moments = " ".join([repr(link.inertia)] * 3)
            opened += (
                f'<body name="{i}" pos="0 0 {-above!r}"><joint name="{i}" axis="0 1 0" '
                f'damping="{link.damping!r}"/><inertial pos="0 0 {-link.com!r}" '
                f'mass="{link.mass!r}" diaginertia="{moments}"/>'
            )
            above = link.length or 0.0
        opened += f'<site pos="0 0 {-above!r}"/>' if above else ""
        return (
            f'<mujoco><compiler angle="radian"/><option gravity="0 0 {-self.gravity!r}"/>'
            f"<worldbody>{opened}{'</body>' * len(self.links)}</worldbody></mujoco>\n"
        )
