"""Files of mechanisms: a MuJoCo model, what was commanded and measured, and what is
uncertain.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.base.settings import Settings, VersionedFile
from drivers.strip.file import Provenance

Positive = Annotated[float, Field(gt=0)]
ACCEPTED_MODEL = "-accepted.xml"  # after a mechanism's name, its accepted model
FIELDS = {"mass": ("body", "kg"), "com": ("body", "m"), "length": ("body", "m"),
          "inertia": ("body", "kg m^2"), "damping": ("joint", "N m s"),
          "armature": ("joint", "kg m^2"), "stiffness": ("joint", "N m/rad"),
          "gain": ("actuator", "1")}  # fmt: skip
# by mode: a kind of signal, an input or a key that a file must have or must not, and
# why
RULES = {
    "prescribed": (
        (True, "torque", "mode prescribed compares torques; no signal is: torque"),
        (
            True,
            "inputs: position",
            "mode prescribed needs inputs: {JOINT: position}, the given motion",
        ),
    ),
    "forward": (
        (False, "cell", "cell: the cell's own arm is compared in mode prescribed"),
        (
            False,
            "tracking",
            "is: tracking is for mode prescribed; others compare positions",
        ),
        (
            False,
            "inputs: position",
            "inputs: position is for mode prescribed; others take ctrl, torque",
        ),
    ),
}
RULES["planar"] = RULES["forward"]  # of pendulums


OWNERS = {
    "joint": ("position", "velocity", "torque", "tracking"),
    "actuator": ("torque",),
    "site": (None,),
    "sensor": (None,),
}
"""What a signal may be of, by what it is read at."""


def _named(spec: Settings, *keys: str) -> list[str]:
    """Names of those `keys` that an entry of the mechanism file states."""
    return [key for key in keys if getattr(spec, key) is not None]


class SignalSpec(Settings):
    """Signal in a column of the runs: measured quantity, its owner, standard deviation
    `sigma`.

    `sigma: repeats` takes it from repeated runs. `tracking` is a measured position
    minus the commanded one. The `side` of the gear on which a torque is read is the
    motor's where a motor is named, and the joint's where a joint is.
    """

    joint: str | None = None
    actuator: str | None = None
    site: str | None = None
    sensor: str | None = None
    is_: Literal["position", "velocity", "torque", "tracking"] | None = Field(
        None, alias="is"
    )
    axis: Literal["x", "y", "z"] | None = None
    side: Literal["joint", "motor"] | None = None
    sigma: Positive | Literal["repeats"]

    @model_validator(mode="after")
    def _one(self) -> Self:
        """Refuse a signal that names no or several owners, or a quantity that its owner
        lacks.
        """
        if len(_named(self, *OWNERS)) != 1:
            raise ValueError("names one of joint, actuator, site and sensor")

        owner = self.owner
        kinds = OWNERS[owner]
        if self.is_ not in kinds:
            raise ValueError(f"is: of a {owner} is one of {kinds}")
        if (self.axis is not None) != (owner == "site"):
            raise ValueError("axis: x, y or z, of a site alone")
        if self.side and self.is_ != "torque":
            raise ValueError("side: joint or motor, of a torque alone")

        return self

    @property
    def owner(self) -> str:
        """Kind of what the signal is read at: joint, actuator, site or sensor."""
        return _named(self, *OWNERS)[0]

    @property
    def name(self) -> str:
        """Name of the joint, actuator, site or sensor that the signal is read at."""
        return str(getattr(self, self.owner))


class StartSpec(Settings):
    """Initial state of a simulation: as measured, as stated, or after settling for
    `settle` [s].
    """

    position: float | Literal["measured"] = "measured"
    velocity: float | Literal["measured"] = "measured"
    spread: Annotated[float, Field(ge=0)] | None = None
    settle: Positive | None = None


class UncertainSpec(Settings):
    """Field of the model to be fitted, and its prior spread, as a share (`2%`) or
    absolute.

    A centre of mass is free along one `axis` of its body, or along all; a length is the
    distance of a body's frame from its parent's.
    """

    body: str | None = None
    joint: str | None = None
    actuator: str | None = None
    field: Literal[
        "mass", "com", "length", "inertia", "damping", "armature", "stiffness", "gain"
    ]
    axis: Literal["x", "y", "z"] | None = None
    spread: Positive | Annotated[str, Field(pattern=r"^[0-9]+(\.[0-9]+)?%$")]
    by_run: Annotated[str, Field(pattern=r"^[0-9]+(\.[0-9]+)?%$")] | None = None

    @model_validator(mode="after")
    def _owner(self) -> Self:
        """Validate the entry: raises ValueError for an owner that does not have the
        field.
        """
        field = self.field
        owner, _ = FIELDS[field]
        if _named(self, "body", "joint", "actuator") != [owner]:
            raise ValueError(
                f"field {field} belongs to a {owner}: name it, and nothing else"
            )
        if self.axis and field != "com":
            raise ValueError("axis: x, y or z, of a com alone")
        return self

    @property
    def owner(self) -> str:
        """Name of the body, joint or actuator that has the field; `*` stands for each
        of them.
        """
        return self.body or self.joint or self.actuator or "*"


class MechanismFile(VersionedFile):
    """Content of a mechanism file: the model, its signals and inputs, and its uncertain
    numbers.
    """

    kind: Literal["mechanism"]
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")
    model: str
    mode: Literal["forward", "prescribed", "planar"] = "forward"
    step: Annotated[float, Field(gt=0, le=0.1)] = 0.002
    hold: Positive | None = None
    signals: dict[str, SignalSpec] = Field(min_length=1)
    inputs: dict[str, Literal["ctrl", "torque", "position"]] = Field(
        default_factory=dict
    )
    start: StartSpec = StartSpec()
    uncertain: tuple[UncertainSpec, ...] = ()
    effects: dict[str, dict[str, float]] = Field(default_factory=dict)
    provenance: tuple[Provenance, ...] = ()
    cell: bool = False  # the cell's own arm: what is found concerns cell.yaml, too

    @model_validator(mode="after")
    def _mode(self) -> Self:
        """Refuse signals and inputs that do not belong to the mode."""
        found = {
            *(signal.is_ for signal in self.signals.values()),
            *["cell"] * self.cell,
        }
        found |= {f"inputs: {kind}" for kind in self.inputs.values()}
        for needed, what, reason in RULES[self.mode]:
            if (what in found) != needed:
                raise ValueError(reason)
        return self
