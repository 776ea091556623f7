"""Base parameters of a mechanism's fit: its uncertain numbers."""

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.effect import Fields, scale_gain
from cell.gap.subject.mechanism.file import MechanismFile, UncertainSpec
from cell.gap.subject.mechanism.model import Mechanism, number_of
from cell.gap.subject.subject import Parameter
from drivers.errors import ConfigurationError

UNITS = {"mass": "kg", "com": "m", "inertia": "kg m^2", "damping": "N m s", "armature": "kg m^2",
         "stiffness": "N m/rad", "gain": "1"}  # fmt: skip
ENOUGH = 1e-9  # of its spread: the smallest number that counts as stated


@dataclass(frozen=True, slots=True)
class Base:
    """A base parameter, how it is put into a model, and its spread from run to run (or None).

    `field` and `owner` name it in the file.
    """

    parameter: Parameter
    put: Callable[[Fields, float], None]
    field: str = ""
    owner: str = ""
    by_run: float | None = None


def base_of(file: MechanismFile, mechanism: Mechanism, origin: str) -> tuple[Base, ...]:
    """Base parameters that `uncertain` lists; ConfigurationError for unknown names."""
    found = [b for i, u in enumerate(file.uncertain)
             for b in _expand(u, mechanism, f"{origin}: uncertain.{i}")]  # fmt: skip
    names = [b.parameter.name for b in found]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice is not None:
        raise ConfigurationError(f"{origin}: uncertain: {twice} is listed twice; keep one")
    return tuple(found)


def stated_fields(base: Sequence[Base], mechanism: Mechanism) -> Collection[str]:
    """Fields of which the `base` holds all joints, all actuators, or the last body."""
    last = mechanism.model.body(int(np.max(mechanism.model.jnt_bodyid))).name
    owners = {"com": {last}, "armature": {j.name for j in mechanism.joints},
              "gain": set(mechanism.actuators)}  # fmt: skip
    return {field for field, names in owners.items()
            if names <= {b.owner for b in base if b.field == field}}  # fmt: skip


def _expand(spec: UncertainSpec, mechanism: Mechanism, origin: str) -> Iterator[Base]:
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
    """Axes of a body along which its centre of mass matters: not that of all joints, where these
    are parallel hinges.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    own = data.xmat[body].reshape(3, 3)
    hinges = bool((model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).all())
    for k, axis in enumerate("xyz"):
        along = np.abs(data.xaxis @ own[:, k])
        if not (hinges and bool((along > 1.0 - 1e-9).all())):
            yield axis


def _base_parameter(
    spec: UncertainSpec, mechanism: Mechanism, number: int, name: str, axis: str
) -> Base:
    start, put, size = _access(spec.field, mechanism, number, axis)
    width = _spread_width(spec.spread, size)
    free = spec.field == "com"
    low = -np.inf if free else (0.2 * start if spec.field in ("mass", "inertia", "gain") else 0.0)
    high = np.inf if free else max(5.0 * start, start + 20.0 * width)
    key = f"com_{axis}" if free else spec.field
    parameter = Parameter(f"{key}_{name}", UNITS[spec.field], start, low, high, 1e-3 * width, width)
    by_run = None if spec.by_run is None else _spread_width(spec.by_run, size)
    return Base(parameter, put, spec.field, name, by_run)


def _spread_width(spread: float | str, size: float) -> float:
    if not isinstance(spread, str):
        return float(spread)
    return float(re.sub("%", "", spread)) / 100.0 * max(abs(size), ENOUGH)


def _access(
    field: str, mechanism: Mechanism, i: int, axis: str
) -> tuple[float, Callable[[Fields, float], None], float]:
    """Start value of a field, its setter, and the size to which a share refers."""
    model: Any = mechanism.model
    if field == "mass":
        start = float(model.body_mass[i])
        return start, lambda f, v: _mass(f, i, v), start
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


def _mass(fields: Fields, i: int, value: float) -> None:
    """Set a mass, and scale its inertia with it."""
    _scale(fields["body_inertia"][i], value / float(fields["body_mass"][i]))
    fields["body_mass"][i] = value


def _scale(array: Any, factor: float) -> None:
    if factor != 1.0:
        array *= factor
