"""Compiled model of a mechanism: its joints with typical sizes, its editable fields,
and those that are uncertain.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import repeat
from operator import setitem
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import mujoco
import numpy as np

from cell.gap.subject.mechanism.mechanism_file import (
    FIELDS,
    MechanismFile,
    UncertainSpec,
)
from cell.gap.subject.mechanism.model_source import ModelSource
from cell.gap.subject.mechanism.recordings import Recording, Signal
from cell.gap.subject.subject import NO_FILE, Origin, ScatterSource
from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

SMALLEST = 1e-9  # size of a number, in SI, to which a spread in percent refers at least
# bounds of a number: times its start value, spreads above it; times the start if it
# cannot vanish
HIGHEST, FARTHEST, LOWEST = 5.0, 20.0, 0.2
STEP = 1e-3  # of the spread, of finite differences
PARALLEL = 1e-9  # by which the cosine of axes that count as parallel may be below 1
POSES = 24  # at which weights and inertias are taken
SMOOTH = 0.02  # rad/s over which compiled dry friction changes sign in a simulation
SMOOTHED = 0.02  # of a joint's typical rate: the same along measured motion


@dataclass(frozen=True, slots=True)
class PredictionMode:
    """Mode in which a mechanism is compared with its runs, such as forward simulation:
    what it predicts, and which effects it can show.

    In mode forward the model is integrated under the recorded commands, and so it is in
    mode planar, that of pendulums; in mode prescribed inverse dynamics gives torques
    along the measured motion. Of a mode:

    - `smoothing(rates)` are rates (joints,) [rad/s] within which dry friction changes
      sign gradually, for typical `rates` (joints,) of the joints.
    - `encoders(mechanism)` are the names of readings that an error of an encoder can
      falsify.
    - `splits(model)` is whether a gear may twist or have play between a motor and its
      link.
    - `loads`: torques and trackings alone are compared, a file's other signals are not
      used. The torque that a gear bears is known, so that friction in proportion to it
      is an amount to be found, and not a shape of the law.
    - `fields`: an effect is put into fields of the MuJoCo model where these can express
      it.
    - `shapes`: parameters that shape a law are fitted, too, and the file's spreads of
      the base are held against what fits.
    - `drag` is the unit and the typical size of the coefficient of the air's drag.
    - `of` is what verdicts say that every effect belongs to; None where each effect
      says so.
    - `group`: readings of joints are absolute angles, shown as one group of this name.
    """

    name: str
    smoothing: Callable[[Array], Array]
    encoders: Callable[["Mechanism"], Sequence[str]]
    splits: Callable[[Any], bool]
    loads: bool = False
    fields: bool = False
    shapes: bool = True
    drag: tuple[str, float] = ("1", 0.02)
    of: Literal["strip"] | None = None
    group: str = ""


FORWARD = PredictionMode(
    name="forward",
    smoothing=lambda rates: 0.0 * rates + SMOOTH,
    encoders=lambda m: [s.name for s in m.compared("position")],
    splits=lambda model: bool(model.nu) and model.body_jntnum.max() == 1,
    fields=True,
)
PRESCRIBED = PredictionMode(
    name="prescribed",
    smoothing=lambda rates: SMOOTHED * rates,
    # biases of encoders would have to move whole loops
    encoders=lambda m: () if m.model.neq else [j.name for j in m.joints],
    splits=lambda model: not model.neq,
    loads=True,
)
PLANAR = replace(
    FORWARD,
    name="planar",
    # the first one's error is a tilted base
    encoders=lambda m: [s.name for s in m.compared("position")[1:]],
    fields=False,
    shapes=False,
    drag=("kg/m^2", 0.01),
    of="strip",  # as verdicts on pendulums state it
    group="angle",
)
MODES: Mapping[str, PredictionMode] = {
    mode.name: mode for mode in (FORWARD, PRESCRIBED, PLANAR)
}


class Joint(NamedTuple):
    """Hinge or slide of a model, with its typical torque [N m], rate [rad/s] and moved
    inertia [kg m^2]; those of a slide are in N, m/s and kg.

    Its number is that of its position, rate and degree of freedom, too.
    `actuator` is the number of the motor that drives it, -1 where none does; `travel`
    [rad] is the largest in a recording, a turn where nothing was measured.
    """

    name: str
    hinge: bool
    actuator: int
    torque: float
    rate: float
    inertia: float
    travel: float


class BaseParameter(NamedTuple):
    """Parameter of the mechanism's own file that is fitted, with the function `put`
    that sets its value in a MuJoCo model.

    `scatter` is how it differs from run to run, if it does.
    """

    parameter: Parameter
    put: Callable[[Any, float], None]
    scatter: ScatterSource | None = None


@dataclass(frozen=True, slots=True)
class Mechanism:
    """Mechanism that a file describes: its compiled MuJoCo model, the signals that are
    compared, and its recordings.

    `pace` [rad/s] is how fast the signals change, `base` are what the file lists as
    uncertain. Where trackings are compared, positions are those of links, and motors
    follow commands.
    """

    file: MechanismFile
    path: Path
    source: ModelSource
    model: Any
    signals: tuple[Signal, ...]
    joints: tuple[Joint, ...] = ()
    recordings: tuple[Recording, ...] = ()
    pace: float = 1.0
    base: tuple[BaseParameter, ...] = ()
    origin: Origin = NO_FILE

    @property
    def mode(self) -> PredictionMode:
        """Mode of prediction in which the mechanism is compared with its runs, such as
        forward or inverse dynamics.
        """
        return MODES[self.file.mode]

    def compared(self, kind: str) -> tuple[Signal, ...]:
        """Compared signals of the given `kind`, such as torque; in inverse dynamics
        torques come first among all signals.
        """
        return tuple(signal for signal in self.signals if signal.kind == kind)

    @property
    def places(self) -> dict[str, str]:
        """Names of the columns of a recording that hold joint positions, by the name of
        the joint.
        """
        signals = self.file.signals.items()
        found = {s.joint: n for n, s in signals if s.joint and s.is_ == "position"}
        given = {n: n for n, kind in self.file.inputs.items() if kind == "position"}
        return found | given

    @property
    def driven(self) -> Self:
        """Copy of the mechanism that has only those of its joints that a
        motor drives.
        """
        return replace(
            self, joints=tuple(joint for joint in self.joints if joint.actuator >= 0)
        )

    @property
    def torque(self) -> Array:
        """Typical torque [N m] of each joint, as an array of shape (joints,)."""
        return np.array([joint.torque for joint in self.joints])

    @property
    def rate(self) -> Array:
        """Typical rate [rad/s] of each joint, as an array of shape (joints,)."""
        return np.array([joint.rate for joint in self.joints])

    @property
    def inertia(self) -> Array:
        """Inertia [kg m^2] that each joint moves, as an array of shape (joints,)."""
        return np.array([joint.inertia for joint in self.joints])


def poses(
    model: Any,
    q: Iterable[Array],
    compute: Callable[[Any, Any], None],
    v: Iterable[Array] | None = None,
) -> Iterator[Any]:
    """Yield MuJoCo's data of a `model` after the function `compute` has filled it, at
    each of the positions `q` of shape (m, joints).

    Rates `v` (m, joints) are zero where none are given.
    """
    data = mujoco.MjData(model)
    for row, rates in zip(q, repeat(0.0) if v is None else v, strict=False):
        data.qpos[:], data.qvel[:] = row, rates
        compute(model, data)
        yield data


def tip(model: Any) -> tuple[int, Array]:
    """Number of the last body that a joint moves, and the place [m] of that body's end
    in its own frame, of shape (3,).

    That is the farthest site or twice the centre of mass.
    """
    body = np.max(model.jnt_bodyid)
    places = [*model.site_pos[model.site_bodyid == body], 2.0 * model.body_ipos[body]]
    return body, np.array(max(places, key=np.linalg.norm))


def scale_gain(edited: Any, actuator: int, factor: float) -> None:
    """Multiply the gain and the bias of the actuator with the number `actuator` in the
    MuJoCo model `edited` by `factor`.
    """
    edited.actuator_gainprm[actuator, :3] *= factor
    edited.actuator_biasprm[actuator, :3] *= factor


def add_point(edited: Any, mass: float, body: int, place: Array) -> None:
    """Add a point of mass `mass` [kg] at `place` [m], of shape (3,) in the frame of the
    body numbered `body`, to that body in the model `edited`.
    """
    one = edited.body(body)
    stated = one.mass[0]
    rotation = np.zeros(9)
    whole = stated + mass
    mujoco.mju_quat2Mat(rotation, one.iquat)
    axes = rotation.reshape(3, 3)
    inertia = axes @ np.diag(one.inertia) @ axes.T
    offset = place - one.ipos
    # parallel axes, about the common centre of mass
    reduced = stated * mass / whole
    inertia += reduced * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    mujoco.mju_eig3(one.inertia, rotation, one.iquat, inertia.ravel())
    one.mass[:] = whole
    one.ipos[:] += offset * mass / whole


def check_joints(model: Any, origin: str) -> None:
    """Raise ConfigurationError where a joint of a model has no name, or is neither a
    hinge nor a slide.
    """
    for i in range(model.njnt):
        name = model.joint(i).name
        kind = int(model.jnt_type[i])
        number = model.jnt_bodyid[i]
        body = model.body(number).name or number
        if not name:
            raise ConfigurationError(
                f"{origin}: a joint of body {body} has no name; give it one"
            )
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            raise ConfigurationError(
                f"{origin}: joint {name}: is free or a ball; allowed: hinge and slide"
            )
    if model.njnt == 0:
        raise ConfigurationError(f"{origin}: has no joint; nothing in it can move")


def actuator_on(model: Any, joint: int) -> int:
    """Number of the first actuator that drives the joint with the number `joint`; -1
    where there is none.
    """
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    hits = np.flatnonzero(on_joint & (model.actuator_trnid[:, 0] == joint))
    return int(hits[0]) if len(hits) else -1


def typical_loads(model: Any) -> tuple[Array, Array]:
    """Largest torque of gravity and mean inertia of each degree of freedom of a model,
    both of shape (degrees of freedom,), in random poses.
    """
    rng = np.random.default_rng(0)
    count = model.nv
    weight = np.zeros(count)
    inertia = np.zeros(count)
    full = np.zeros((count, count))
    low, high = model.jnt_range.T
    limited = (model.jnt_limited > 0) & (high > low)
    low, high = np.where(limited, (low, high), np.pi * np.array([[-1.0], [1.0]]))
    q = rng.uniform(low, high, (POSES, count))

    for data in poses(model, q, mujoco.mj_forward):
        weight = np.maximum(weight, np.abs(data.qfrc_bias))
        mujoco.mj_fullM(model, data, full)
        inertia += np.diag(full) / POSES

    return weight, inertia


def number_of(model: Any, kind: str, name: str, origin: str, key: str) -> int:
    """Number, in the MuJoCo `model`, of the part of a `kind` such as body or joint that
    is called `name`; ConfigurationError where there is none.
    """
    count = {"body": "nbody", "joint": "njnt", "actuator": "nu", "site": "nsite",
             "sensor": "nsensor"}[kind]  # fmt: skip
    names: Sequence[str] = [
        getattr(model, kind)(i).name for i in range(getattr(model, count))
    ]
    if name not in names:
        allowed = ", ".join(n for n in names if n) or "none"
        raise ConfigurationError(
            f"{origin}: {key}: no {kind} {name!r}; allowed: {allowed}"
        )
    return names.index(name)


def base_of(mechanism: Mechanism) -> tuple[BaseParameter, ...]:
    """Parameters that the file of a mechanism lists as uncertain; ConfigurationError
    where it names what the model does not have.
    """
    origin = f"{mechanism.path}: uncertain"
    found: dict[str, BaseParameter] = {}
    for i, spec in enumerate(mechanism.file.uncertain):
        for each in _expand(spec, mechanism, f"{origin}.{i}"):
            name = each.parameter.name
            if name in found:
                raise ConfigurationError(f"{origin}: {name} is listed twice; keep one")
            found[name] = each
    return tuple(found.values())


def _expand(
    spec: UncertainSpec, mechanism: Mechanism, origin: str
) -> Iterator[BaseParameter]:
    """Yield the parameters of one entry in the list of uncertain fields, at least one
    for each part that a `*` stands for.
    """
    model = mechanism.model
    kind, _ = FIELDS[spec.field]
    numbers: Sequence[int] = range(model.njnt if kind == "joint" else model.nu)
    if spec.owner != "*":
        numbers = [number_of(model, kind, name=spec.owner, origin=origin, key=kind)]
    elif kind == "body":
        numbers = [i for i in range(1, model.nbody) if model.body_mass[i] > 0.0]

    for number in numbers:
        name = getattr(model, kind)(number).name
        if not name:
            raise ConfigurationError(
                f"{origin}: {kind} *: a {kind} has no name; give each one"
            )
        axes = spec.axis or _free_axes(model, number) if spec.field == "com" else ("",)
        for axis in axes:
            yield _base_parameter(spec, mechanism, number, name, axis)


def _free_axes(model: Any, body: int) -> Iterator[str]:
    """Yield the axes, among x, y and z of a body, along which a shift of its centre of
    mass affects the motion.
    """
    (data,) = poses(model, [model.qpos0], mujoco.mj_kinematics)
    along = np.abs(data.xaxis @ data.xmat[body].reshape(3, 3)) > 1.0 - PARALLEL
    slides = (model.jnt_type != mujoco.mjtJoint.mjJNT_HINGE).any()
    for axis, parallel in zip("xyz", along.all(axis=0), strict=True):
        if slides or not parallel:
            yield axis


def _base_parameter(
    spec: UncertainSpec, mechanism: Mechanism, number: int, name: str, axis: str
) -> BaseParameter:
    """Parameter, with its bounds, for one uncertain field of the part with the number
    `number`; `axis` is that of a centre of mass.
    """
    field = spec.field
    start, put, size = _access(field, mechanism, number, axis)
    width = _spread_width(spec.spread, size)
    high = max(HIGHEST * start, start + FARTHEST * width)
    low = LOWEST * start if field in ("mass", "inertia", "gain") else 0.0
    if field == "com":
        low = -np.inf
        high = np.inf

    key = "_".join(filter(None, (field, axis, name)))
    _, unit = FIELDS[field]
    step = STEP * width
    parameter = Parameter(
        name=key, unit=unit, start=start, low=low, high=high, step=step, spread=width
    )
    by_run = _spread_width(spec.by_run or 0.0, size)
    if not by_run:
        return BaseParameter(parameter, put)

    what = f"{field} of {name}"
    scatter = ScatterSource(
        name=f"{key}_run",
        sentence=what,
        remedy=f"keep the {what} steady",
        unit=unit,
        usual=by_run,
        step=step,
        common=True,
    )
    return BaseParameter(parameter, put, scatter)


def _spread_width(spread: float | str, size: float) -> float:
    """Width of the prior of a field: the stated `spread` or, where that is a
    percentage, this part of `size`.
    """
    if isinstance(spread, str):
        return float(spread.rstrip("%")) / 100.0 * max(abs(size), SMALLEST)
    return float(spread)


def _access(
    field: str, mechanism: Mechanism, i: int, axis: str
) -> tuple[float, Callable[[Any, float], None], float]:
    """Start value of the `field` of part number `i`, the function that sets it in a
    model, and its typical size, to which percentages refer.
    """
    model: Any = mechanism.model
    if field == "mass":
        start = model.body_mass[i]
        return start, lambda f, v: _set_mass(f, i, v), start
    if field == "inertia":
        start = model.body_inertia[i].max()
        return (
            start,
            lambda f, v: setitem(f.body_inertia, i, v / start * f.body_inertia[i]),
            start,
        )
    if field == "gain":
        return 1.0, lambda f, v: scale_gain(f, i, v), 1.0
    if field == "length":
        place = model.body_pos[i]
        start = max(float(np.linalg.norm(place)), SMALLEST)
        return start, lambda f, v: setitem(f.body_pos, i, v * (place / start)), start
    if field == "com":
        k = "xyz".index(axis)
        place = model.body_ipos[i]
        size = float(np.linalg.norm(place))
        return place[k], lambda f, v: setitem(f.body_ipos, (i, k), v), size

    joint = mechanism.joints[i]
    name, size = {
        "stiffness": ("jnt_stiffness", joint.torque),
        "damping": ("dof_damping", joint.torque / joint.rate),
        "armature": ("dof_armature", joint.inertia),
    }[field]
    start = getattr(model, name)[i]
    return start, lambda f, v: setitem(getattr(f, name), i, v), start or size


def _set_mass(edited: Any, i: int, value: float) -> None:
    """Set the mass of body number `i` in the model `edited` to `value` [kg], and scale
    its inertia in proportion.
    """
    edited.body_inertia[i] *= value / edited.body_mass[i]
    edited.body_mass[i] = value
