"""Base parameters of a mechanism's fit: the model's numbers that its file lists as uncertain."""

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.fields import Fields, scale_gain
from cell.gap.subject.mechanism.file import MechanismFile, UncertainSpec
from cell.gap.subject.mechanism.model import Mechanism, number_of
from cell.gap.subject.subject import Parameter
from drivers.errors import ConfigurationError

UNITS = {"mass": "kg", "com": "m", "inertia": "kg m^2", "damping": "N m s", "armature": "kg m^2",
         "stiffness": "N m/rad", "gain": "1"}  # fmt: skip
SMALLEST = 1e-9  # size of a number, in SI, to which a spread in percent refers at least
# bounds of a number: times its start value, spreads above it; times the start if it cannot vanish
HIGHEST, FARTHEST, LOWEST = 5.0, 20.0, 0.2
STEP = 1e-3  # of the spread, of finite differences
PARALLEL = 1e-9  # by which the cosine of axes that count as parallel may be below 1


@dataclass(frozen=True, slots=True)
class Base:
    """Base parameter of a fit, with the setter `put` that writes its value into a model's fields.

    `field` and `owner` name it in the file; `by_run` is its spread from run to run, if any.
    """

    parameter: Parameter
    put: Callable[[Fields, float], None]
    field: str = ""
    owner: str = ""
    by_run: float | None = None


def base_of(file: MechanismFile, mechanism: Mechanism, origin: str) -> tuple[Base, ...]:
    """Base parameters that the file lists as `uncertain`; ConfigurationError for unknown names."""
    found = [b for i, spec in enumerate(file.uncertain)
             for b in _expand(spec, mechanism, f"{origin}: uncertain.{i}")]  # fmt: skip
    names = [b.parameter.name for b in found]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice is not None:
        raise ConfigurationError(f"{origin}: uncertain: {twice} is listed twice; keep one")
    return tuple(found)


def stated_fields(base: Sequence[Base], mechanism: Mechanism) -> Collection[str]:
    """Fields that `base` fits for every owner: all joints, all actuators, or the last body."""
    last = mechanism.model.body(int(np.max(mechanism.model.jnt_bodyid))).name
    owners = {"com": {last}, "armature": {j.name for j in mechanism.joints},
              "gain": set(mechanism.actuators)}  # fmt: skip
    return {field for field, names in owners.items()
            if names <= {b.owner for b in base if b.field == field}}  # fmt: skip


def _expand(spec: UncertainSpec, mechanism: Mechanism, origin: str) -> Iterator[Base]:
    """Base parameters of one entry of `uncertain`, one or more for each owner that `*` matches."""
    model = mechanism.model
    kind = "body" if spec.body else "joint" if spec.joint else "actuator"
    names: Sequence[str]
    if spec.owner != "*":
        names = [spec.owner]
        number_of(model, kind, spec.owner, origin, kind)
    elif kind == "body":
        names = [model.body(i).name for i in range(1, model.nbody) if model.body_mass[i] > 0.0]
        if "" in names:
            raise ConfigurationError(f"{origin}: body *: a body has no name; give each one")
    else:
        names = [j.name for j in mechanism.joints] if kind == "joint" else mechanism.actuators
    for name in names:
        number = getattr(model, kind)(name).id
        for axis in _free_axes(model, number) if spec.field == "com" else ("",):
            yield _base_parameter(spec, mechanism, number, name, axis)


def _free_axes(model: Any, body: int) -> Iterator[str]:
    """Axes of a body along which its centre of mass matters: those not parallel to all hinges."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    own = data.xmat[body].reshape(3, 3)
    hinges = bool((model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).all())
    for k, axis in enumerate("xyz"):
        along = np.abs(data.xaxis @ own[:, k])
        if not (hinges and bool((along > 1.0 - PARALLEL).all())):
            yield axis


def _base_parameter(
    spec: UncertainSpec, mechanism: Mechanism, number: int, name: str, axis: str
) -> Base:
    """Base parameter for one field of one owner, with its bounds; `axis` is that of a com."""
    start, put, size = _access(spec.field, mechanism, number, axis)
    width = _spread_width(spec.spread, size)
    if spec.field == "com":
        key, low, high = f"com_{axis}", -np.inf, np.inf
    else:
        key, high = spec.field, max(HIGHEST * start, start + FARTHEST * width)
        low = LOWEST * start if spec.field in ("mass", "inertia", "gain") else 0.0
    parameter = Parameter(
        f"{key}_{name}", UNITS[spec.field], start, low, high, step=STEP * width, spread=width
    )
    by_run = None if spec.by_run is None else _spread_width(spec.by_run, size)
    return Base(parameter, put, spec.field, name, by_run)


def _spread_width(spread: float | str, size: float) -> float:
    """Absolute spread: as stated, or the stated percentage of `size`."""
    if not isinstance(spread, str):
        return float(spread)
    return float(re.sub("%", "", spread)) / 100.0 * max(abs(size), SMALLEST)


def _access(
    field: str, mechanism: Mechanism, i: int, axis: str
) -> tuple[float, Callable[[Fields, float], None], float]:
    """Start value, setter and typical size, to which percentages refer, of owner `i`'s `field`."""
    model: Any = mechanism.model
    if field == "mass":
        start = float(model.body_mass[i])
        return start, lambda f, v: _set_mass(f, i, v), start
    if field == "com":
        k, place = "xyz".index(axis), model.body_ipos[i]
        size = float(np.linalg.norm(place))
        return float(place[k]), lambda f, v: _set_value(f["body_ipos"][i], k, v), size
    if field == "inertia":
        start = float(model.body_inertia[i].max())
        return start, lambda f, v: _scale(f["body_inertia"][i], v / start), start
    if field == "gain":
        return 1.0, lambda f, v: scale_gain(f, i, v), 1.0
    joint = mechanism.joints[i]
    name, at, size = {
        "stiffness": ("jnt_stiffness", i, joint.torque),
        "damping": ("dof_damping", joint.dof, joint.torque / joint.rate),
        "armature": ("dof_armature", joint.dof, joint.inertia),
    }[field]
    start = float(getattr(model, name)[at])
    return start, lambda f, v: _set_value(f[name], at, v), start or size


def _set_value(array: Any, i: int, value: float) -> None:
    array[i] = value


def _set_mass(fields: Fields, i: int, value: float) -> None:
    """Set a body's mass [kg], and scale its inertia in proportion."""
    _scale(fields["body_inertia"][i], value / float(fields["body_mass"][i]))
    fields["body_mass"][i] = value


def _scale(array: Any, factor: float) -> None:
    if factor != 1.0:
        array *= factor
