"""Effects of a mechanism: how each changes the model, a command, a reading or a
torque.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from cell.gap.subject.mechanism.model import FORWARD, PRESCRIBED, Joint, Mechanism
from cell.gap.subject.subject import Candidate, starts
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter, Role

# relative errors of laws of friction, springs, gears and bases that sway, and of all
# others
UNTRUE, EXACT = 0.2, 0.02
SIZES_PER_SPREAD = 25.0  # typical sizes of a parameter in its prior spread
STEPS_PER_SIZE = 1000.0  # steps of finite differences in a typical size
Parameters = Callable[[Mechanism], tuple[Parameter, ...]]


class Readings(NamedTuple):
    """Errors of sensors and commands, where a sensor reads (1 + scale) x(t - delay) +
    bias for the true quantity x at time t.

    `bias` and `scale` are those of encoders (encoders,), delays (1,) are in [s].
    `command` delays every command; `elastic` (joints,) [rad/(N m)] and `gap` (joints,)
    [rad] lie between a joint's encoder and its link.
    """

    delay: Array | float = 0.0
    command: Array | float = 0.0
    bias: Array | float = 0.0
    scale: Array | float = 0.0
    elastic: Array | float = 0.0
    gap: Array | float = 0.0


@dataclass(frozen=True, slots=True)
class MechanismEffect:
    """Effect in the library of mechanisms, such as dry friction: its parameters, and
    the functions by which it changes a simulation.

    At the start values of its parameters it changes nothing. It acts by one or more of
    these:

    - `law(q, v, load, p, at)`: torque [N m] on a joint at angle q and rate v whose gear
      bears a load; compiled. Of the joint's numbers p, `keys` from `at` on are the
      effect's, and p[1] is the rate within which signs are smooth. `of_drives`: on
      joints that a motor drives alone.
    - `edit(mechanism, values, model)`: new values in fields of a MuJoCo model, which an
      MJCF can state; beside a law, it stands for the law where the mode has effects as
      `fields`, by the first `edited` of its keys.
    - `path(mechanism, values, t, q, v)`: torques (m, joints) that depend on the motion
      so far.
    - `read`: the field of `Readings`, of what lies between mechanism and record, that
      it states.

    `parameters` are those of one key, joint by joint, then of the next; `shape` are
    shapes of the law. The effect is a candidate in `modes` of simulation where it is
    `possible`, unless the file says how well the field `error_of` of the base is known.
    It is screened at `probes`, in typical sizes, for each of a `grid` of values of its
    last parameter.
    """

    name: str
    sentence: str
    parameters: Parameters
    revealed_by: str
    shape: Parameters = lambda _: ()
    of: Literal["model", "rig"] = "model"
    keys: int = 1
    law: Callable[..., Array] | None = None
    edit: Callable[[Mechanism, Array, Any], None] | None = None
    edited: int | None = None
    read: Literal["delay", "command", "bias", "scale", "elastic", "gap"] | None = None
    path: Callable[[Mechanism, Array, Array, Array, Array], Array] | None = None
    possible: Callable[[Mechanism], bool] = lambda _: True
    modes: Collection[str] = (FORWARD.name, PRESCRIBED.name)
    probes: Sequence[float] = (0.03, 0.3, 3.0)
    grid: Sequence[float] = ()
    error_of: str = ""
    of_drives: bool = False

    def applies(self, mechanism: Mechanism) -> bool:
        """Whether `mechanism` can have the effect, and its mode of prediction can show
        it.
        """
        fits = mechanism.mode.name in self.modes and self.possible(mechanism)
        return fits and bool(self.parameters(mechanism))

    def by_fields(self, mechanism: Mechanism) -> bool:
        """Whether fields of the MuJoCo model of `mechanism` can express all that the
        effect does.
        """
        is_edit = self.edit is not None and self.read is None
        return is_edit and (self.law is None or mechanism.mode.fields)

    def moves(self, mechanism: Mechanism) -> bool:
        """Whether the effect changes what is computed once for several requests, which
        is a simulation, or in inverse dynamics the torques of the true motion.
        """
        # is an error of reading a motion
        falsifies = self.read in ("delay", "bias", "scale")
        if mechanism.mode.loads:
            return falsifies or self.by_fields(mechanism)
        return not falsifies

    def candidate(self, mechanism: Mechanism) -> Candidate:
        """Effect as a candidate for the fit of `mechanism`, with the values at which it
        is tried first: one parameter at a time, from small to large.
        """
        parameters = self.parameters(mechanism)
        null = starts(parameters)
        sizes = np.diag([p.spread / SIZES_PER_SPREAD for p in parameters])
        amounts = [row for row, p in zip(sizes, parameters, strict=True) if p.is_amount]
        groups = tuple(
            tuple(
                tuple((np.append(null[:-1], last) + factor * size).tolist())
                for size in amounts
            )
            for last in self.grid or null[-1:]
            for factor in self.probes
        )
        of_joint = self.law or self.read
        error = UNTRUE if self.path or (of_joint and self.of == "model") else EXACT
        return Candidate(
            name=self.name,
            sentence=self.sentence,
            of=mechanism.mode.of or self.of,
            parameters=parameters,
            probes=groups,
            revealed_by=self.revealed_by,
            model_error=error,
            shape_parameters=self.with_shape(mechanism)[len(parameters) :],
            usual=parameters[0].spread,
        )

    def with_shape(self, mechanism: Mechanism) -> tuple[Parameter, ...]:
        """Parameters of the effect in `mechanism`, then those that shape its torque
        function, unless the mode of prediction keeps these fixed.
        """
        shapes = self.shape(mechanism) if mechanism.mode.shapes else ()
        return (*self.parameters(mechanism), *shapes)

    def table(self, mechanism: Mechanism, values: Array) -> Array:
        """Parameter values with a row for each kind of parameter and a column for each
        joint, of which the first are `values` and the others have their start values.
        """
        missing = starts(self.with_shape(mechanism)[len(values) :])
        acts = [joint.actuator >= 0 or not self.of_drives for joint in mechanism.joints]
        rows = np.concatenate([values, missing]).reshape(-1, sum(acts))
        table = np.zeros((len(rows), len(acts)))
        table[:, acts] = rows
        return table


def per_joint(
    mechanism: Mechanism,
    key: str,
    unit: str,
    size: Array,
    *,
    signed: bool = False,
    role: Role = "amount",
    high: float = 250.0,
) -> tuple[Parameter, ...]:
    """Parameters named `key_JOINT`, one for each joint, whose typical sizes are the
    array `size` of shape (joints,); for slides the `unit` has N and m in place of N m
    and rad.
    """
    slides = unit.replace("N m", "N").replace("rad", "m")
    found = []
    for joint, s in zip(mechanism.joints, size, strict=True):
        own = unit if joint.hinge else slides
        name = f"{key}_{joint.name}"
        (p,) = single_parameter(name, own, s, signed=signed, high=high)
        found.append(replace(p, role=role))
    return tuple(found)


def single_parameter(
    key: str,
    unit: str,
    size: float,
    *,
    signed: bool = False,
    high: float = 250.0,
) -> tuple[Parameter, ...]:
    """Tuple of one parameter named `key` for the whole mechanism, which starts at zero
    and typically has the given `size` in its `unit`.
    """
    low = -high * size if signed else 0.0
    step = size / STEPS_PER_SIZE
    spread = SIZES_PER_SPREAD * size
    return (
        Parameter(
            name=key,
            unit=unit,
            start=0.0,
            low=low,
            high=high * size,
            step=step,
            spread=spread,
        ),
    )


def shapes(
    joints: Sequence[Joint],
    key: str,
    unit: str,
    starts: Iterable[float],
    bounds: tuple[float, float],
    step: float,
    spread: float = 1.0,
) -> tuple[Parameter, ...]:
    """Parameters named `key_JOINT` that shape the torque function of an effect, one for
    each of `joints`, with positive start values `starts`.

    Bounds, step of finite differences and prior spread are in units of each start.
    """
    low, high = bounds
    return tuple(
        Parameter(
            name=f"{key}_{joint.name}",
            unit=unit if joint.hinge else unit.replace("rad", "m"),
            start=start,
            low=low * start,
            high=high * start,
            step=step * start,
            spread=spread * start,
            role="shape",
        )
        for joint, start in zip(joints, map(float, starts), strict=True)
    )


def errors(
    key: str,
    unit: str,
    names: Iterable[str | int],
    low: float,
    high: float,
    spread: float,
) -> tuple[Parameter, ...]:
    """Parameters named `key_NAME`, one for each of `names`, that start at zero and lie
    between `low` and `high` in their `unit`.
    """
    return tuple(
        Parameter(
            name=f"{key}_{name}",
            unit=unit,
            start=0.0,
            low=low,
            high=high,
            step=1e-5,
            spread=spread,
        )
        for name in names
    )


def add_to(field: str) -> Callable[[Mechanism, Array, Any], None]:
    """Function that edits a MuJoCo model: it adds the first parameter value of each
    joint to the array `field` of the model.
    """

    def edit(mechanism: Mechanism, values: Array, edited: Any) -> None:
        rows = getattr(edited, field).reshape(len(mechanism.joints), -1)
        rows[:, 0] += values[: len(rows)]

    return edit


Known = Sequence[tuple[MechanismEffect, Array]]
"""Effects with their values (k,)."""


def readings_of(known: Known) -> Readings:
    """Errors of sensors and commands that the effects in `known`, each given with its
    parameter values, state.
    """
    return Readings(**{effect.read: values for effect, values in known if effect.read})
