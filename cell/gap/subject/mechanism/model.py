"""Reads MuJoCo models without foreign code, and finds typical sizes of their joints."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from drivers.errors import ConfigurationError
from drivers.readers import MEGABYTE, read_text
from drivers.types import Array

ASSETS = ("file", "meshdir", "texturedir", "assetdir", "filename")
LIGHT = 1e-3  # kg m^2 below which MuJoCo's own dry friction is too weak
POSES = 24  # at which weights and inertias are taken
LEAST_TORQUE = 1e-9  # N m, typical torque of a joint that neither weight nor motion loads
LEAST_WEIGHT = 1e-12  # N m, weight by which a joint without gravity would swing


@dataclass(frozen=True, slots=True)
class Joint:
    """Hinge or slide of a model, with typical torque [N m], rate [rad/s] and inertia [kg m^2].

    `actuator` is the number of the motor that drives it, -1 where none does.
    """

    name: str
    hinge: bool
    qpos: int
    dof: int
    actuator: int
    torque: float
    rate: float
    inertia: float


@dataclass(frozen=True, slots=True)
class Mechanism:
    """Compiled model with its joints and signals, and the `mode` in which it is simulated.

    `xml` is the model's text. `mode` is `forward`, `prescribed`, or `planar`, a chain of hinges
    that swings by its own equations. Compared `torques` and `trackings` are named with the number
    of their joint; where there are trackings, positions are those of links, and motors follow
    commands. `native` says that MuJoCo's own dry friction is used, not the compiled one.
    """

    name: str
    mode: str
    step: float
    xml: str
    model: Any
    joints: tuple[Joint, ...]
    actuators: tuple[str, ...]
    encoders: tuple[str, ...]
    torques: tuple[tuple[str, int], ...]
    native: bool
    trackings: tuple[tuple[str, int], ...] = ()

    @property
    def last_body(self) -> int:
        """Number of the last body that a joint moves."""
        return int(np.max(self.model.jnt_bodyid))

    @property
    def torque(self) -> Array:
        """Typical torque [N m] of each joint (joints,)."""
        return np.array([j.torque for j in self.joints])

    @property
    def rate(self) -> Array:
        """Typical rate [rad/s] of each joint (joints,)."""
        return np.array([j.rate for j in self.joints])

    @property
    def inertia(self) -> Array:
        """Inertia [kg m^2] that each joint moves (joints,)."""
        return np.array([j.inertia for j in self.joints])


def tip(mechanism: Mechanism, body: int) -> Array:
    """Position (3,) [m] in a body's frame of its end: farthest site or twice the centre of mass."""
    model = mechanism.model
    places = [model.site_pos[i] for i in range(model.nsite) if model.site_bodyid[i] == body]
    places.append(2.0 * model.body_ipos[body])
    return np.array(max(places, key=lambda p: float(np.linalg.norm(p))))


def read_xml(path: Path, folder: Path) -> str:
    """Read the text of the MJCF or URDF at `path`, self-contained and without foreign code.

    Raises ConfigurationError for text that is no XML, plugins, and files outside `folder`.
    """
    text = read_text(path, 20 * MEGABYTE)
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise ConfigurationError(f"{path}: declares XML entities; write them out")
    try:
        root = ET.fromstring(text)  # noqa: S314  entities were refused above
    except ET.ParseError as error:
        raise ConfigurationError(f"{path}: is not valid XML: {error}; mend it") from None
    if root.tag not in ("mujoco", "robot"):
        raise ConfigurationError(f"{path}: root is <{root.tag}>; give MJCF or URDF")
    for element in root.iter():
        if element.tag in ("plugin", "extension"):
            raise ConfigurationError(
                f"{path}: <{element.tag}>: plugins run foreign code and are refused; remove it"
            )
        for key in ASSETS:
            place = element.get(key)
            if place is not None:
                _check_inside(path, place, folder)
        if element.tag == "include":
            raise ConfigurationError(
                f"{path}: <include>: is not followed; save the model whole (mj_saveLastXML)"
            )
    return text


def _check_inside(path: Path, place: str, folder: Path) -> None:
    whole = (folder / place.removeprefix("package://")).resolve()
    if Path(place).is_absolute() or not whole.is_relative_to(folder.resolve()):
        raise ConfigurationError(
            f"{path}: {place}: lies outside {folder}; paths of a model stay in its folder"
        )


def compile_model(
    xml: str, origin: str, slots: int, step: float, *, folder: Path | None = None
) -> Any:
    """Compile `xml` to an MjModel with `slots` user numbers per joint and steps of `step` [s].

    RK4 replaces the Euler integrator. Raises ConfigurationError for a model that does not load.
    """
    assets = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()} if folder else {}
    try:
        spec = mujoco.MjSpec.from_string(xml, assets=assets)
        spec.nuser_jnt = slots
        spec.option.timestep = step
        if spec.option.integrator == mujoco.mjtIntegrator.mjINT_EULER:
            spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        raise ConfigurationError(f"{origin}: does not load: {reason[:160]}; mend it") from None
    model.body_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE  # or edited frames are ignored
    return model


def check_joints(model: Any, origin: str) -> None:
    """Refuse joints without a name or of a kind other than hinge and slide."""
    for i in range(model.njnt):
        name, kind = model.joint(i).name, int(model.jnt_type[i])
        body = model.body(int(model.jnt_bodyid[i])).name or int(model.jnt_bodyid[i])
        if not name:
            raise ConfigurationError(f"{origin}: a joint of body {body} has no name; give it one")
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            raise ConfigurationError(
                f"{origin}: joint {name}: is free or a ball; allowed: hinge and slide"
            )
    if model.njnt == 0:
        raise ConfigurationError(f"{origin}: has no joint; nothing in it can move")


def joints_of(model: Any, rms: dict[str, tuple[float, float]], driven: dict[str, float]
              ) -> tuple[Joint, ...]:  # fmt: skip
    """Joints of a model, with their typical torques, rates and inertias.

    `rms` holds measured rates and accelerations by joint, `driven` measured torques; where nothing
    was measured, gravity and inertia in poses drawn at random are typical.
    """
    weight, inertia = _typical_loads(model)
    found = []
    for i in range(model.njnt):
        name, dof = model.joint(i).name, int(model.jnt_dofadr[i])
        rate, acceleration = rms.get(name, (0.0, 0.0))
        torque = driven.get(name) or max(weight[dof], inertia[dof] * acceleration, LEAST_TORQUE)
        swing = float(np.sqrt(max(weight[dof], LEAST_WEIGHT) / inertia[dof]))
        found.append(Joint(name, bool(model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE),
                           int(model.jnt_qposadr[i]), dof, _driver(model, i), float(torque),
                           float(rate or swing), float(inertia[dof])))  # fmt: skip
    return tuple(found)


def _driver(model: Any, joint: int) -> int:
    """Number of the first actuator on a joint, -1 where there is none."""
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    hits = np.flatnonzero(on_joint & (model.actuator_trnid[:, 0] == joint))
    return int(hits[0]) if len(hits) else -1


def _typical_loads(model: Any) -> tuple[Array, Array]:
    """Largest torque of gravity and mean inertia (nv,) by degree of freedom, in random poses."""
    rng, data = np.random.default_rng(0), mujoco.MjData(model)
    weight, inertia = np.zeros(model.nv), np.zeros(model.nv)
    full = np.zeros((model.nv, model.nv))
    limited = model.jnt_limited.astype(bool) & (model.jnt_range[:, 1] > model.jnt_range[:, 0])
    low = np.where(limited, model.jnt_range[:, 0], -np.pi)
    high = np.where(limited, model.jnt_range[:, 1], np.pi)
    for _ in range(POSES):
        data.qpos[:] = rng.uniform(low, high)
        mujoco.mj_forward(model, data)
        weight = np.maximum(weight, np.abs(data.qfrc_bias))
        mujoco.mj_fullM(model, data, full)
        inertia += np.diag(full) / POSES
    return weight, inertia


def number_of(model: Any, kind: str, name: str, origin: str, key: str) -> int:
    """Number of the body, joint, actuator, site or sensor `name`; ConfigurationError lists them."""
    count = {"body": "nbody", "joint": "njnt", "actuator": "nu", "site": "nsite",
             "sensor": "nsensor"}[kind]  # fmt: skip
    names: Sequence[str] = [getattr(model, kind)(i).name for i in range(getattr(model, count))]
    if name not in names:
        allowed = ", ".join(n for n in names if n) or "none"
        raise ConfigurationError(f"{origin}: {key}: no {kind} {name!r}; allowed: {allowed}")
    return names.index(name)
