"""An effect of a mechanism: how it changes the model, a command, a reading or a joint's torque."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from cell.gap.subject.mechanism.model import Joint, Mechanism
from cell.gap.subject.subject import Candidate, Parameter
from drivers.types import Array

Of = Literal["model", "rig"]
MODES = ("forward", "prescribed", "planar")
Parameters = Callable[[Mechanism], tuple[Parameter, ...]]


class Fields(Protocol):
    """Fields of a model by MuJoCo's names (`dof_damping`, `opt.gravity`), each to be edited."""

    def __getitem__(self, name: str) -> Array:
        """Array of the field called `name`, to be edited in place."""


@dataclass(slots=True)
class Readings:
    """Errors of sensors and commands, by signal or input: (1 + scale) x(t - delay) + bias.

    `command` [s] delays every command; `elastic` (joints,) [rad/(N m)] and `gap` (joints,) [rad]
    lie between a joint's encoder and its link.
    """

    delay: float = 0.0
    command: float = 0.0
    bias: dict[str, float] = field(default_factory=dict)
    scale: dict[str, float] = field(default_factory=dict)
    elastic: Array | None = None
    gap: Array | None = None


@dataclass(frozen=True, slots=True)
class Effect:
    """An effect in the library of mechanisms; every hook does nothing at the parameters' starts.

    `parameters` lists all values of one key, joint by joint, then the next key; `shape` are shapes
    of the law. `law` is a compiled torque `(q, v, load, p, at) -> N m` of one joint with its own
    values from `p[at]` on, `keys` of them, on a joint that smooths signs over `p[3]`; `edit`
    changes fields of the model, and stands for the law in a simulation where it is `native`;
    `path` is a torque (m, joints) that depends on the motion so far; `read` changes what lies
    between world and record. An MJCF can say what `edit` does. `holds` is the largest torque by
    which a law holds a joint that stands, of the law's arguments. `error_of` is a field of the base
    that it is an error of: where the file says how well that is known, it is no effect.
    """

    name: str
    sentence: str
    of: Of
    source: str
    parameters: Parameters
    revealed_by: str
    shape: Parameters = lambda _: ()
    keys: int = 0
    law: Callable[..., Array] | None = None
    edit: Callable[[Mechanism, Array, Fields], None] | None = None
    read: Callable[[Mechanism, Array, Readings], None] | None = None
    path: Callable[[Mechanism, Array, Array, Array], Array] | None = None
    native: Callable[[Mechanism], bool] = lambda _: True
    modes: Sequence[str] = ("forward", "prescribed")
    probes: Sequence[float] = (0.03, 0.3, 3.0)
    error_of: str = ""
    holds: Callable[..., Array] | None = None

    def applies(self, mechanism: Mechanism) -> bool:
        """Whether this mechanism, simulated this way, can have the effect."""
        return mechanism.mode in self.modes and bool(self.parameters(mechanism))

    def edits(self, mechanism: Mechanism) -> bool:
        """Whether the effect is nothing but edits of the model's fields here."""
        if self.edit is None or self.read is not None:
            return False
        return self.law is None or (mechanism.mode == "forward" and self.native(mechanism))

    def candidate(self, mechanism: Mechanism) -> Candidate:
        """The effect as a candidate, probed one parameter at a time, small to large."""
        own = self.parameters(mechanism)
        width = np.array([p.spread / 25.0 for p in own])
        groups = tuple(
            tuple(
                tuple(map(float, _null(own) + (np.arange(len(own)) == i) * width * factor))
                for i in range(len(own))
                if not own[i].shape
            )
            for factor in self.probes
        )
        shape = self.shape(mechanism)
        of = "strip" if mechanism.mode == "planar" else self.of  # as verdicts on pendulums state it
        return Candidate(self.name, self.sentence, of, own, groups, self.revealed_by,
                         shape_parameters=shape)  # fmt: skip

    def with_shape(self, mechanism: Mechanism) -> tuple[Parameter, ...]:
        """The effect's parameters, followed by those of its shape."""
        return (*self.parameters(mechanism), *self.shape(mechanism))

    def table(self, mechanism: Mechanism, values: Array) -> Array:
        """`values` as (keys, joints), what was not given at its start."""
        whole = np.concatenate([values, _null(self.with_shape(mechanism)[len(values) :])])
        return whole.reshape(-1, len(mechanism.joints))


def _null(parameters: Sequence[Parameter]) -> Array:
    return np.array([p.start for p in parameters])


def per_joint(
    mechanism: Mechanism, key: str, unit: str, size: Array, *, signed: bool = False,
    shape: bool = False, high: float = 250.0,
) -> tuple[Parameter, ...]:  # fmt: skip
    """A parameter a joint, `key_JOINT`, of typical `size` (joints,); of slides in N and m."""
    found = []
    for joint, s in zip(mechanism.joints, size, strict=True):
        low = -high * s if signed else 0.0
        shown = unit if joint.hinge else unit.replace("N m", "N").replace("rad", "m")
        found.append(Parameter(f"{key}_{joint.name}", shown, 0.0, low, high * s, s / 1000.0,
                               25.0 * s, shape=shape))  # fmt: skip
    return tuple(found)


def single(
    key: str, unit: str, size: float, *, signed: bool = False, high: float = 250.0,
) -> tuple[Parameter, ...]:  # fmt: skip
    """One parameter for the whole mechanism."""
    low = -high * size if signed else 0.0
    return (Parameter(key, unit, 0.0, low, high * size, size / 1000.0, 25.0 * size),)


def per_encoder(mechanism: Mechanism, key: str, unit: str, spread: float) -> tuple[Parameter, ...]:
    """One parameter an encoder, `key_ENCODER`, for an error of its readings."""
    return tuple(
        Parameter(f"{key}_{name}", unit, 0.0, -0.2, 0.2, 1e-5, spread)
        for name in mechanism.encoders
    )


def put_by_encoder(key: str) -> Callable[[Mechanism, Array, Readings], None]:
    """A setter that writes the values of encoders into the readings under `key`."""

    def read(mechanism: Mechanism, values: Array, readings: Readings) -> None:
        getattr(readings, key).update(zip(mechanism.encoders, map(float, values), strict=True))

    return read


def driven_joints(mechanism: Mechanism) -> list[Joint]:
    """The joints that motors drive."""
    return [j for j in mechanism.joints if j.actuator >= 0]


def has_gears(mechanism: Mechanism) -> bool:
    """Whether each driven joint can be split into motor and link, or is rigid."""
    one_each = int(mechanism.model.body_jntnum.max()) == 1
    return mechanism.mode == "prescribed" or bool(mechanism.actuators and one_each)


def add_to(field: str) -> Callable[[Mechanism, Array, Fields], None]:
    """An edit that adds the first value of each joint to a `field` of its degree of freedom."""

    def edit(mechanism: Mechanism, values: Array, fields: Fields) -> None:
        for joint, value in zip(mechanism.joints, values, strict=False):
            if value != 0.0:
                fields[field].reshape(mechanism.model.nv, -1)[joint.dof, 0] += value

    return edit


def scale_gain(fields: Fields, actuator: int, factor: float) -> None:
    """Multiply an actuator's gain and bias by a `factor`."""
    if factor != 1.0:
        fields["actuator_gainprm"][actuator, :3] *= factor
        fields["actuator_biasprm"][actuator, :3] *= factor


def readings_of(known: Sequence[tuple[Effect, Array]], mechanism: Mechanism) -> Readings:
    """Errors of sensors and commands by effects with their values (parameters,)."""
    readings = Readings()
    for effect, values in known:
        if effect.read is not None:
            effect.read(mechanism, values, readings)
    return readings
