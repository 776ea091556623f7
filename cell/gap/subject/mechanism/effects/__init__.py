"""Library of effects of mechanisms, a family in each file, and checks of accepted ones.

Further effects come from plug-ins, entry points in the group
`folding_cell.mechanism_effects`.
"""

import ctypes
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numba
import numpy as np
from numba import types

from cell.gap.subject.mechanism.effect import MechanismEffect, per_joint
from cell.gap.subject.mechanism.effects import bodies, compliance, drives, friction
from cell.gap.subject.mechanism.effects.drives import bias_law
from cell.gap.subject.mechanism.model import MODES, PRESCRIBED, Mechanism
from cell.gap.subject.subject import Candidate
from drivers.base.errors import ConfigurationError
from drivers.base.jit import callback, kernel
from drivers.base.plugins import plugins
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter, check_values

HEAD = 2  # first user numbers of a joint: count of joints, its smoothing rate
# length of the view of an array of joints whose length is not known
MOST_JOINTS = 1 << 12
STRUCT_WORDS = 1 << 17  # pointers of a MuJoCo struct that are searched
_LOCK = threading.Lock()


def _chain_laws(laws: Sequence[tuple[Callable[..., Array], int, int]]) -> Any:
    """Compiled function of a joint's angle, rate, gear load and parameters that gives
    the sum of the torques of all `laws`.
    """
    if not laws:
        return kernel(lambda q, v, load, p: 0.0)  # noqa: ARG005
    law, at, keys = laws[0]
    others = _chain_laws(laws[1:])
    own: Any = kernel(law)

    def both(q, v, load, p):  # type: ignore[no-untyped-def]
        torque = 0.0
        if p[at : at + keys].any():
            torque = own(q, v, load, p, at)
        return torque + others(q, v, load, p)

    return kernel(both)


class TorqueLaws:
    """Torque functions of joint angle, rate and load that MuJoCo lacks; each joint of a
    model has `slots` user numbers, which hold the parameters of all functions.
    """

    def __init__(self, laws: Sequence[tuple[str, Callable[..., Array], int]]) -> None:
        """Assign places among the user numbers of a joint to `laws`, each given by its
        name, its torque function and the number of its parameters.
        """
        self._laws: dict[str, tuple[Callable[..., Array], int, int]] = {}
        self.at: dict[str, int] = {}
        self.slots = HEAD
        for name, law, count in laws:
            self._laws[name] = law, self.slots, count
            self.at[name] = self.slots
            self.slots += count
        self._callbacks: dict[frozenset[str], Any] = {}

    def along(self, q: Array, v: Array, load: Array, user: Array) -> Array:
        """Sum of the torques of all functions, a row for each time and a column for
        each joint, along positions `q`, rates `v` and gear loads `load` of the same
        shape; `user` holds a row of parameters for each joint.
        """
        found = np.zeros_like(q)
        for j, p in enumerate(user):
            for law, at, keys in self._laws.values():
                if p[at : at + keys].any():
                    found[:, j] += law(q[:, j], v[:, j], load[:, j], p, at)
        return found

    @contextmanager
    def install(self, names: frozenset[str], model: Any) -> Iterator[None]:
        """Context in which MuJoCo adds the torques of the functions called `names` to
        every simulation of models with the layout of `model`.

        Other threads wait.
        """
        with _LOCK:
            made = self._callbacks.get(names)
            if not made:
                law = _chain_laws([self._laws[name] for name in sorted(names)])
                made = self._callbacks[names] = _callback(law, model, self.slots)
            mujoco.set_mjcb_passive(made.ctypes)
            # MuJoCo reads the clock a dozen times a step
            mujoco.set_mjcb_time(_zero().ctypes)
            try:
                yield
            finally:
                mujoco.set_mjcb_passive(None)
                mujoco.set_mjcb_time(None)


def _callback(law: Any, model: Any, slots: int) -> Any:
    """Compiled function, to be set as MuJoCo's callback `mjcb_passive`, that adds the
    torque that the function `law` gives to every joint.

    Arrays are found by the address that each has in a `model`, for the layout of
    MuJoCo's structs changes with its version.
    """
    data = mujoco.MjData(model)
    pointers = types.CPointer(types.CPointer(types.float64))
    user_at = _offset(model, model.jnt_user)
    qpos_at, qvel_at, passive_at = (
        _offset(data, array) for array in (data.qpos, data.qvel, data.qfrc_passive)
    )

    @callback(types.void(pointers, pointers))
    def add(model, data):  # type: ignore[no-untyped-def]
        user = numba.carray(model[user_at], (MOST_JOINTS, slots))
        for j in range(int(user[0, 0])):
            torque = law(data[qpos_at][j], data[qvel_at][j], 0.0, user[j])
            if torque != 0.0:
                numba.carray(data[passive_at], (MOST_JOINTS,))[j] += torque

    return add


@cache
def _zero() -> Any:
    """Compiled function without arguments that serves MuJoCo as a clock and always
    returns zero.
    """
    return callback(types.float64())(lambda: 0.0)


def _offset(struct: Any, array: Array) -> int:
    """Position, counted in pointers, at which a MuJoCo struct keeps the pointer to the
    data of `array`.
    """
    words = (ctypes.c_uint64 * STRUCT_WORDS).from_address(struct._address)
    for at, word in enumerate(words):
        if word == array.ctypes.data:
            return at
    raise RuntimeError("this MuJoCo keeps its arrays where they were not found")


def _cubic(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of cubic damping at joint rates `v` [rad/s]: minus the parameter
    `p[at]` times the cube of the rate.
    """
    return -p[at] * v**3


def _cubic_spring(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of a cubic spring at joint angles `q` [rad]: minus the parameter
    `p[at]` times the cube of the angle.
    """
    return -p[at] * q**3


def _bent_viscous(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of viscous friction that grows with the angle: minus the parameter
    `p[at]` times the size of the angle `q` [rad] times the rate `v` [rad/s].
    """
    return -p[at] * abs(q) * v


def _load_dry(q: Array, v: Array, load: Array, p: Array, at: int) -> Any:
    """Torque [N m] of dry friction in proportion to the size of the gear's `load` [N
    m], by the factor `p[at]`; its sign is smoothed over the rate `p[1]` [rad/s].
    """
    return -p[at] * abs(load) * v / (abs(v) + p[1])


def _term(
    name: str,
    sentence: str,
    law: Callable[..., Array],
    size: Callable[[Mechanism], Array],
    modes: Collection[str] = MODES,
) -> MechanismEffect:
    """Descriptive effect named `term_` and `name`, whose torque function `law` has one
    parameter for each joint, typically a hundredth of what `size` gives for it.
    """
    return MechanismEffect(
        name=f"term_{name}",
        sentence=sentence,
        parameters=lambda m: per_joint(m, "torque", "N m", 0.01 * size(m), signed=True),
        revealed_by="",
        law=law,
        modes=modes,
    )


TERMS = (
    _term("constant", "a steady torque", bias_law, lambda m: m.torque),
    _term("cubic", "rate^3", _cubic, lambda m: m.torque / m.rate**3),
    _term("cubic_spring", "angle^3", _cubic_spring, lambda m: m.torque),
    _term("bent_viscous", "|angle| rate", _bent_viscous, lambda m: m.torque / m.rate),
    _term(
        name="load_dry",
        sentence="|load| sign(rate)",
        law=_load_dry,
        size=lambda m: m.torque / m.torque,
        modes=(PRESCRIBED.name,),
    ),
)
"""Generic joint torques that describe unexplained residuals and are never named as
causes.
"""


@cache
def registry() -> Mapping[str, MechanismEffect]:
    """All effects that a mechanism may have, by name: those of this library, and those
    that plug-ins add.
    """
    families = map(vars, (bodies, compliance, drives, friction))
    known = {
        e.name: e
        for family in families
        for e in family.values()
        if isinstance(e, MechanismEffect)
    }
    return dict(
        sorted(
            {**known, **plugins("mechanism_effects", MechanismEffect, known)}.items()
        )
    )


@cache
def library() -> Mapping[str, MechanismEffect]:
    """All effects of mechanisms and all descriptive terms, which have no physical
    cause, by name.
    """
    return {**registry(), **{term.name: term for term in TERMS}}


@cache
def torques() -> TorqueLaws:
    """Torque functions of all effects and descriptive terms of mechanisms, assigned to
    the user numbers of a joint.
    """
    return TorqueLaws([(e.name, e.law, e.keys) for e in library().values() if e.law])


def candidates(mechanism: Mechanism) -> tuple[Candidate, ...]:
    """Candidate effects for the fit of `mechanism`, without those that its file has
    accepted and those that its uncertain fields already express.
    """
    file = mechanism.file
    uncertain = {spec.field for spec in file.uncertain}
    return tuple(
        e.candidate(mechanism)
        for name, e in registry().items()
        if name not in file.effects
        and e.error_of not in uncertain
        and e.applies(mechanism)
    )


def accepted_parameters(mechanism: Mechanism) -> Iterator[Parameter]:
    """Parameters, named `effect.parameter`, by which effects that the mechanism's file
    has accepted are fitted again from their stated values.
    """
    for name, values in mechanism.file.effects.items():
        effect = library()[name]
        starts = ordered_values(effect, mechanism, values)
        for p, start in zip(effect.with_shape(mechanism), starts, strict=True):
            yield replace(p, name=f"{name}.{p.name}", start=start)


def check_effects(mechanism: Mechanism) -> None:
    """Raise ConfigurationError where the file of `mechanism` states an effect that it
    cannot have, or a parameter value out of range.
    """
    known = {name: e for name, e in library().items() if e.applies(mechanism)}
    for name, values in mechanism.file.effects.items():
        origin = f"{mechanism.path}: effects.{name}"
        if name not in known:
            raise ConfigurationError(
                f"{origin}: unknown effect; allowed: {', '.join(known)}"
            )
        effect = known[name]
        amounts = effect.parameters(mechanism)
        shapes = effect.with_shape(mechanism)[len(amounts) :]
        check_values(values, amounts, shapes, origin)


def ordered_values(
    effect: MechanismEffect, mechanism: Mechanism, values: Mapping[str, float]
) -> Array:
    """Values of an effect's parameters in their order, as an array of shape
    (parameters,), from `values` by name; the start value where a name is missing there.
    """
    found = []
    for p in effect.with_shape(mechanism):
        stated = values.get(p.name)
        found.append(p.start if stated is None else p.stated_value(stated))
    return np.array(found)
