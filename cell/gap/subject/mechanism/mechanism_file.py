"""Files of mechanisms: a MuJoCo model with its signals, and a pendulum's links.

Of a MuJoCo model a file says what was commanded and measured, and what is uncertain; of a pendulum
the properties of a chain of hinged links as its maker states them.
"""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.settings import Metres, Settings, Unit
from drivers.strip.file import Provenance

Length = Annotated[Metres, Field(ge=1e-4, le=100.0)]
Mass = Annotated[float, Unit("kg"), Field(ge=1e-6, le=1e5)]
Inertia = Annotated[float, Unit("kg m^2"), Field(ge=1e-14, le=1e8)]
Damping = Annotated[float, Unit("N m s"), Field(ge=0.0, le=1e6)]
RADIUS = 0.005  # m of the rods that air brakes
# blunt, slender, angular, lift, spin: a rod of 0.2 m about its end, as integrated along it
DRAG = (1.0, 0.1, 1.5, 0.0, 0.0)
DRAG_UNIT = 1.2 * 2.0 * RADIUS * math.pi / 4.0  # kg/m^2 at the density of air
Positive = Annotated[float, Field(gt=0)]
BodyField = Literal["mass", "com", "inertia", "damping", "armature", "stiffness", "gain"]
OWNERS = {"mass": "body", "com": "body", "inertia": "body", "damping": "joint", "armature": "joint",
          "stiffness": "joint", "gain": "actuator"}  # fmt: skip
# by mode: a kind of signal, an input or a key that a file must have or must not, and why
RULES = {
    "prescribed": ((True, "torque", "mode prescribed compares torques; no signal is: torque"),
                   (True, "inputs: position",
                    "mode prescribed needs inputs: {JOINT: position}, the given motion")),
    "forward": ((False, "cell", "cell: the cell's own arm is compared in mode prescribed"),
                (False, "tracking",
                 "is: tracking is for mode prescribed; forward compares positions"),
                (False, "inputs: position",
                 "inputs: position is for mode prescribed; forward takes ctrl, torque")),
}  # fmt: skip


class SignalSpec(Settings):
    """Signal in a column of the runs: measured quantity, its owner, standard deviation `sigma`.

    `sigma: repeats` takes it from repeated runs. `tracking` is a measured position minus the
    commanded one. The `side` of the gear on which a torque is read is the motor's where a motor is
    named, and the joint's where a joint is.
    """

    joint: str | None = None
    actuator: str | None = None
    site: str | None = None
    sensor: str | None = None
    is_: Literal["position", "velocity", "torque", "tracking"] | None = Field(None, alias="is")
    axis: Literal["x", "y", "z"] | None = None
    side: Literal["joint", "motor"] | None = None
    sigma: Positive | Literal["repeats"]

    @model_validator(mode="after")
    def _one(self) -> Self:
        """Refuse a signal that names no or several owners, or a quantity that its owner lacks."""
        named = [k for k in ("joint", "actuator", "site", "sensor") if getattr(self, k) is not None]
        if len(named) != 1:
            raise ValueError("names one of joint, actuator, site and sensor")
        kinds = {
            "joint": ("position", "velocity", "torque", "tracking"),
            "actuator": ("torque",),
        }.get(named[0], (None,))
        if self.is_ not in kinds:
            raise ValueError(f"is: of a {named[0]} is one of {kinds}")
        if (self.axis is not None) != (named[0] == "site"):
            raise ValueError("axis: x, y or z, of a site alone")
        if self.side is not None and self.is_ != "torque":
            raise ValueError("side: joint or motor, of a torque alone")
        return self


class StartSpec(Settings):
    """Initial state of a simulation: as measured, as stated, or after settling for `settle` [s]."""

    position: float | Literal["measured"] = "measured"
    velocity: float | Literal["measured"] = "measured"
    spread: Annotated[float, Field(ge=0)] | None = None
    settle: Positive | None = None


class UncertainSpec(Settings):
    """Field of the model to be fitted, and its prior spread, as a share (`2%`) or absolute."""

    body: str | None = None
    joint: str | None = None
    actuator: str | None = None
    field: BodyField
    spread: Positive | Annotated[str, Field(pattern=r"^[0-9]+(\.[0-9]+)?%$")]
    by_run: Annotated[str, Field(pattern=r"^[0-9]+(\.[0-9]+)?%$")] | None = None

    @model_validator(mode="after")
    def _owner(self) -> Self:
        """Refuse an owner that does not have the field."""
        owner = OWNERS[self.field]
        if [k for k in ("body", "joint", "actuator") if getattr(self, k) is not None] != [owner]:
            raise ValueError(f"field {self.field} belongs to a {owner}: name it, and nothing else")
        return self

    @property
    def owner(self) -> str:
        """Name of the body, joint or actuator that has the field; `*` stands for each of them."""
        return self.body or self.joint or self.actuator or "*"


class MechanismFile(Settings):
    """Content of a mechanism file: the model, its signals and inputs, and its uncertain numbers."""

    schema_: Literal[1] = Field(1, alias="schema")
    kind: Literal["mechanism"]
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    model: str
    mode: Literal["forward", "prescribed"] = "forward"
    step: Annotated[float, Field(gt=0, le=0.1)] = 0.002
    hold: Positive | None = None
    signals: dict[str, SignalSpec] = Field(min_length=1)
    inputs: dict[str, Literal["ctrl", "torque", "position"]] = Field(default_factory=dict)
    start: StartSpec = StartSpec()
    uncertain: tuple[UncertainSpec, ...] = ()
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)
    provenance: tuple[Provenance, ...] = ()
    cell: bool = False  # the cell's own arm: what is found concerns cell.yaml, too

    @model_validator(mode="after")
    def _mode(self) -> Self:
        """Refuse signals and inputs that do not belong to the mode."""
        found = {*(s.is_ for s in self.signals.values()), *["cell"] * self.cell}
        found |= {f"inputs: {kind}" for kind in self.inputs.values()}
        for needed, what, reason in RULES[self.mode]:
            if (what in found) != needed:
                raise ValueError(reason)
        return self


class Link(Settings):
    """Link of a pendulum: mass [kg], length to the next joint [m], centre of mass [m], inertia.

    Inertia [kg m^2] is about the centre of mass, damping [N m s] is viscous, of the link's joint.
    """

    mass: Mass
    length: Length | None
    com: Length
    inertia: Inertia
    damping: Damping


class PendulumFile(Settings):
    """Content of a pendulum file: gravity [m/s^2], links and accepted effects."""

    schema_: Literal[1] = Field(1, alias="schema")
    kind: Literal["pendulum"]
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    gravity: float = Field(ge=1.0, le=30.0)
    links: tuple[Link, ...] = Field(min_length=1, max_length=6)
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)
    provenance: tuple[Provenance, ...] = ()

    @model_validator(mode="after")
    def _lengths(self) -> Self:
        """Refuse links without a length, or whose mass lies beyond their end."""
        *inner, last = self.links
        if any(link.length is None for link in inner):
            raise ValueError("only the last link may have no length")
        if last.length is not None and last.com > 10.0 * last.length:
            raise ValueError("the last link's com lies far beyond its end")
        return self

    def xml(self) -> str:
        """MJCF text of the chain, hanging at zero; its bodies and joints are called 1, 2, 3, ...

        The coefficient of air drag is a force per length and squared speed [kg/m^2].
        """
        opened, above = "", 0.0
        drag = " ".join(str(share / DRAG_UNIT) for share in DRAG)
        for i, link in enumerate(self.links, start=1):
            moments = " ".join([repr(link.inertia)] * 3)
            rod = min(2.0 * link.com, link.com + (3.0 * link.inertia / link.mass) ** 0.5)
            opened += (
                f'<body name="{i}" pos="0 0 {-above!r}"><joint name="{i}" axis="0 1 0" '
                f'damping="{link.damping!r}"/><inertial pos="0 0 {-link.com!r}" '
                f'mass="{link.mass!r}" diaginertia="{moments}"/><geom type="capsule" mass="0" '
                f'fromto="0 0 0 0 0 {-(link.length or rod)!r}" size="{RADIUS}" contype="0" '
                f'conaffinity="0" fluidshape="ellipsoid" fluidcoef="{drag}"/>'
            )
            above = link.length or 0.0
        return (
            f'<mujoco><compiler angle="radian"/><option gravity="0 0 {-self.gravity!r}"/>'
            f"<worldbody>{opened}{'</body>' * len(self.links)}</worldbody></mujoco>\n"
        )
