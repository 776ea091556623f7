"""Makes runs of modelled mechanisms with hidden causes and bases that are wrong.

Models are those that others wrote, in a folder of their packages, and chains of motors
on hinges beside this module, one of them on a cart.
"""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.model import add_point, tip
from cell.gap.subject.mechanism.model_source import read_source
from drivers.base.errors import ConfigurationError
from drivers.base.files import replace_file
from drivers.base.readers import read_yaml
from drivers.base.types import Array
from drivers.base.yaml_text import dump_yaml
from tests.support.mechanisms import write_run

HERE = Path(__file__).parent
LISTS = read_yaml(Path(__file__).with_suffix(".yaml"))
RUNS, SPAN, STEP, EVERY = 4, 4.0, 1e-3, 4  # number, s, s, steps per reading
# steps in a step where commands drive: a coarse one looks like the air's drag
FINER = 16
# s before a record, in which the servo takes the mechanism to its first place
SETTLE = 1.0
SERVO = 40.0  # 1/s of a servo: critically damped
# rad or m, share of a joint's torque: one sigma of a reading
ANGLE, TORQUE = 1e-4, 0.02
# rad, m, share of a joint's range: the most of a motion
REACH, SLIDE, INSIDE = 0.5, 0.05, 0.35
CLOSED = (4.0 * STEP, 1.0)  # s, damping ratio of the spring that closes loops
HARD = 0.9999  # impedance of dry friction: joints do not creep where it holds them
# rad/s or m/s of a wanted rate, above which a servo adds what friction takes
CREEP = 0.02
LIGHT = 0.01  # of the moving mass; a body below it has no stated uncertainty
# rad under its torque; share of it; 1/rad where it has REACH
TWIST, RIPPLE, TURN = 0.01, 0.15, 6.0
# causes at size one: s; shares of a joint's torque and of its motor's constant; rad
DELAY, BIAS, CONSTANT_ERROR, ENCODER_BIAS = 0.006, 0.06, 0.15, 0.05
PAYLOAD, TILT, BENT = 0.03, 0.06, 0.25  # share of the moving mass, rad, rad
# share of a link's mass, m: errors of a base, beyond its spread
HEAVIER, SHIFT = 0.6, 0.03
# rad/s of a base, its damping ratio, its inertia over that of what it carries, and its
# joint
ROCKS, LOSS, HEAVY, ROCKING = 12.0, 0.05, 4.0, "rocking base"


@dataclass(slots=True)
class Rig:
    """True mechanism with `driven` joints, whose typical torques are `weight` (driven,)
    [N m].

    `gear` (driven,) [N m] is at a joint for a unit of its motor.
    """

    model: Any
    mode: str
    driven: list[int]
    actuators: list[int]
    gear: Array
    weight: Array

    def moving(self) -> list[int]:
        """Bodies with a name and a mass that matters, which joints move."""
        m = self.model
        heavy = m.body_mass > LIGHT * m.body_mass[m.body_weldid > 0].sum()
        return [
            i
            for i in range(1, m.nbody)
            if m.body_weldid[i] and heavy[i] and m.body(i).name
        ]


@dataclass(frozen=True, slots=True)
class Motion:
    """Readings at times `t` (n,) [s], which causes change: `joints` (n, all), `torques`
    (n, driven) [N m], `commands` (n, actuators).
    """

    t: Array
    joints: Array
    torques: Array
    commands: Array


Edit = Callable[[Rig, float, np.random.Generator], None]
Reading = Callable[[Motion, Rig, float, np.random.Generator], None]


def _payload(rig: Rig, size: float, _: np.random.Generator) -> None:
    m = rig.model
    mass = PAYLOAD * size * float(m.body_mass[m.body_weldid > 0].sum())
    add_point(m, mass, *tip(m))


def _tilt(rig: Rig, size: float, _: np.random.Generator) -> None:
    angle, g = TILT * size, rig.model.opt.gravity
    g[1:] = (
        g[1] * np.cos(angle) - g[2] * np.sin(angle),
        g[1] * np.sin(angle) + g[2] * np.cos(angle),
    )


def _heavier(rig: Rig, size: float, rng: np.random.Generator) -> None:
    body = rng.choice(rig.moving())
    rig.model.body_mass[body] *= 1.0 + HEAVIER * size
    rig.model.body_inertia[body] *= 1.0 + HEAVIER * size


def _shift(rig: Rig, size: float, rng: np.random.Generator, field: str) -> None:
    """Wrong base: a joint's body, or a centre of mass, that lies elsewhere than the
    file says.
    """
    way, m = rng.standard_normal(3), rig.model
    # where a body fixed to another lies, a centre of mass does
    bodies = [b for b in rig.moving() if field == "body_ipos" or m.body_jntnum[b]]
    getattr(m, field)[rng.choice(bodies)] += SHIFT * size * way / np.linalg.norm(way)


def _bend(rig: Rig, size: float, rng: np.random.Generator) -> None:
    """Foreign cause: a skewed axis; the first joint's would tilt the base, a turn be
    its bias.
    """
    joint = rng.choice(rig.driven[1:] or range(1, rig.model.njnt))
    turn, quat = np.zeros(4), rig.model.body_quat[rig.model.jnt_bodyid[joint]]
    across = np.cross(rig.model.jnt_axis[joint], rng.dirichlet(np.ones(3)) ** 0.5)
    mujoco.mju_axisAngle2Quat(turn, across / np.linalg.norm(across), BENT * size)
    mujoco.mju_mulQuat(quat, quat.copy(), turn)


EDITS: dict[str, Edit] = {
    "payload": _payload,
    "base_tilt": _tilt,
    "bent_link": _bend,
    "wrong_mass": _heavier,
    "wrong_com": partial(_shift, field="body_ipos"),
    "wrong_geometry": partial(_shift, field="body_pos"),
}
FIELDS = {  # MuJoCo's field, and share of a joint's torque at size one
    "dry_friction": ("dof_frictionloss", 0.06),
    "quadratic_damping": ("dof_dampingpoly", 0.03),
    "cable_spring": ("jnt_stiffness", 0.15),
    "armature": ("dof_armature", 0.01),
}


def _constant(motion: Motion, _: Rig, size: float, __: np.random.Generator) -> None:
    """Hidden error of motor constants, larger than stated, which are known to 10 to 20
    %.
    """
    motion.torques[:] /= 1.0 + CONSTANT_ERROR * size


def _torque_bias(motion: Motion, rig: Rig, size: float, _: np.random.Generator) -> None:
    signs = (-1.0) ** np.arange(len(rig.driven))
    motion.torques[:] += signs * BIAS * size * rig.weight


def _encoder_bias(
    motion: Motion, rig: Rig, size: float, _: np.random.Generator
) -> None:
    motion.joints[:, rig.driven[-1]] += ENCODER_BIAS * size


def _bolt(motion: Motion, rig: Rig, size: float, _: np.random.Generator) -> None:
    """Foreign cause: a loose bolt, a gap of the last joint that opens where its load is
    large.
    """
    load = motion.torques[:, -1] / rig.weight[-1]
    gap = 0.06 * size * np.sign(load) * (np.abs(load) > 0.25)
    motion.joints[:, rig.driven[-1]] += gap


def _cable(motion: Motion, rig: Rig, size: float, _: np.random.Generator) -> None:
    """Foreign cause: a cable that catches at one angle of the last joint, and pulls
    only there.
    """
    near = np.exp(-(((motion.joints[:, rig.driven[-1]] - 0.2) / 0.08) ** 2))
    motion.torques[:, -1] += 0.3 * size * rig.weight[-1] * near


def _supply(motion: Motion, _: Rig, size: float, rng: np.random.Generator) -> None:
    """Foreign cause: a supply voltage that wanders, and torques estimated from currents
    with it.
    """
    steps, t = rng.standard_normal(8), motion.t
    slow = np.interp(t, np.linspace(0.0, t[-1], 8), steps)
    motion.torques[:] *= (1.0 + 0.08 * size * slow)[:, None]


def _twist(motion: Motion, rig: Rig, size: float, _: np.random.Generator) -> None:
    motion.joints[:, rig.driven] += TWIST * size * motion.torques / rig.weight


def _ripple(motion: Motion, rig: Rig, size: float, _: np.random.Generator) -> None:
    orders = TURN * REACH / _reach(rig)  # as many waves in a short travel
    places = motion.joints[:, rig.driven]
    waves = np.sin(orders * places + np.arange(len(rig.driven)))
    motion.torques[:] += RIPPLE * size * rig.weight * waves


def _sensor_delay(motion: Motion, _: Rig, size: float, __: np.random.Generator) -> None:
    for column in motion.joints.T:
        column[:] = np.interp(motion.t - DELAY * size, motion.t, column)


READINGS: dict[str, Reading] = {
    "torque_bias": _torque_bias,
    "torque_constant": _constant,
    "encoder_bias": _encoder_bias,
    "loose_bolt": _bolt,
    "catching_cable": _cable,
    "wandering_supply": _supply,
    "joint_elasticity": _twist,
    "torque_ripple": _ripple,
    "sensor_delay": _sensor_delay,
}


def _rocking(spec: Any) -> Any:
    """Compiled model of `spec` on a base body that turns about a horizontal axis."""
    whole = mujoco.MjSpec()
    whole.modelfiledir, whole.option.gravity = spec.modelfiledir, spec.option.gravity
    base = whole.worldbody.add_body(mass=1.0, inertia=np.ones(3), explicitinertial=True)
    base.add_joint(name=ROCKING)
    whole.attach(spec, frame=base.add_frame(), prefix="")
    return whole.compile()


def _rock(rig: Rig, size: float, rng: np.random.Generator) -> None:
    """Make the base rock about a random horizontal axis, at a rate that falls with
    `size`.
    """
    m, along = rig.model, int(rng.integers(2))
    m.jnt_axis[0] = np.eye(3)[along]
    mujoco.mj_setConst(m, mujoco.MjData(m))
    inertia, rate = (1.0 + HEAVY) * m.dof_M0[0], ROCKS / np.sqrt(size)
    m.body_inertia[m.jnt_bodyid[0]] = HEAVY * m.dof_M0[0]
    m.jnt_stiffness[0], m.dof_damping[0] = (
        inertia * rate**2,
        2.0 * LOSS * inertia * rate,
    )


def _source(folder: Path, name: str) -> tuple[Path, dict[str, Any]]:
    """Folder of the model `name` with its files, and its entry in the list of
    models.
    """
    if name in LISTS["chains"]:
        return HERE / "chains", {"folder": "chains", "file": f"{name}.xml"}
    known = LISTS["models"][name]
    return folder / known["folder"], known


def open_rig(folder: Path, name: str, *, rocks: bool = False) -> Rig:
    """Mechanism `name` of `folder`, on a rocking base if `rocks`; ConfigurationError if
    absent.
    """
    home, known = _source(folder, name)
    path = (home / known["file"]).resolve()
    if not path.is_file():
        raise ConfigurationError(
            f"{name}: {known['folder']}/{known['file']} is not in {folder.name};"
            " install its package there (pip install --no-deps --target), and give the"
            " folder as --models"
        )
    spec, off = read_source(path, path.parent).spec(), mujoco.mjtDisableBit
    m = _rocking(spec) if rocks else spec.compile()
    mode = known.get("mode", "prescribed")
    m.opt.timestep = STEP / FINER if mode == "forward" else STEP
    m.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    m.opt.disableflags |= int(off.mjDSBL_CONTACT)
    m.opt.disableflags |= 0 if mode == "forward" else int(off.mjDSBL_ACTUATION)
    m.eq_solref[:], m.dof_solimp[:, :2] = CLOSED, HARD
    m.body_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    motors = np.flatnonzero(m.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT)
    pairs = {int(m.actuator_trnid[a, 0]): int(a) for a in motors}
    bare = [m.joint(joint).id for joint in known.get("motors", ())] or range(
        rocks, m.njnt
    )
    pairs = pairs or dict.fromkeys(bare, -1)
    gear = [m.actuator_gear[a, 0] if a >= 0 else 1.0 for a in pairs.values()]
    return Rig(
        m, mode, list(pairs), list(pairs.values()), np.array(gear), np.ones(len(gear))
    )


def make_runs(
    folder: Path,
    name: str,
    hidden: Sequence[str],
    size: float,
    seed: int,
    out: Path,
    noise: float = 1.0,
    repeats: int = 1,
) -> Path:
    """Write model `name` of `folder`, and runs with `hidden` causes and `noise`, to
    `out`; file.

    With `repeats` two motions are made so often, or else RUNS once.
    """
    rng, rig = np.random.default_rng(seed), open_rig(folder, name)
    rig.weight = weights(rig, seed)
    home, known = _source(folder, name)
    shutil.copytree(home, out, dirs_exist_ok=True)
    replace_file(out / "study.yaml", dump_yaml(_content(rig, known["file"])).encode())
    if "base_compliance" in hidden:
        rig = replace(open_rig(folder, name, rocks=True), weight=rig.weight)
        _rock(rig, size, rng)
    for cause in hidden:
        if cause in FIELDS:
            field, share = FIELDS[cause]
            rows = getattr(rig.model, field).reshape(rig.model.nv, -1)
            rows[rig.model.jnt_dofadr[rig.driven], 0] += share * size * rig.weight
        if cause in EDITS:
            EDITS[cause](rig, size, rng)
    mujoco.mj_setConst(rig.model, mujoco.MjData(rig.model))
    motions, places = RUNS if repeats == 1 else 2, []
    for k in range(motions * repeats):
        delay = DELAY * size if "control_delay" in hidden else 0.0
        places += [_places(rig, rng, None)] if k < motions else []
        motion = _simulate(rig, places[k % motions], delay)
        for cause in filter(READINGS.__contains__, hidden):
            READINGS[cause](motion, rig, size, rng)
        table = _measured(motion, rig, rng, noise)
        head = {"mechanism": "study", "index": k, "condition": f"{k % motions:02d}"}
        write_run(out / "study-runs" / f"{k:02d}", table, head)
    return out / "study.yaml"


def weights(rig: Rig, seed: int) -> Array:
    """Typical torques (driven,) [N m] of the joints, twice their spread in a motion of
    `seed`.
    """
    plain = _simulate(rig, _places(rig, np.random.default_rng(seed), 1.0))
    return np.asarray(2.0 * plain.torques.std(axis=0))


def _content(rig: Rig, model: str) -> dict[str, Any]:
    """Content of a mechanism file that trusts the model: uncertain values, signals,
    inputs.
    """
    m = rig.model
    names = [m.joint(i).name for i in range(m.njnt)]
    bodies = [m.body(i).name for i in rig.moving()]
    free = [{"body": n, "field": "mass", "spread": "2%"} for n in bodies]
    free.append({"joint": "*", "field": "damping", "spread": "50%"})
    common = {"schema": 1, "kind": "mechanism", "name": "study", "model": model}
    if rig.mode == "forward":
        read = {"is": "position", "sigma": ANGLE}
        return {
            **common,
            "uncertain": free,
            "mode": "forward",
            "step": 2.0 * STEP,
            "hold": EVERY * STEP,
            "start": {"position": "measured", "velocity": "measured", "spread": 1e-3},
            "signals": {f"q{i}": {"joint": n, **read} for i, n in enumerate(names, 1)},
            "inputs": dict.fromkeys(
                [m.actuator(a).name for a in rig.actuators], "ctrl"
            ),
        }
    loop, signals = rig.mode == "loop", {}
    free += [{"body": n, "field": "com", "spread": 0.003} for n in bodies * (not loop)]
    given = [names[i] for i in rig.driven] if loop else names
    sigmas = 0.5 * TORQUE * rig.weight / np.abs(rig.gear)
    for i, (joint, sigma) in enumerate(zip(rig.driven, sigmas, strict=True), 1):
        read = {"joint": names[joint], "is": "torque", "side": "motor"}
        signals[f"t{i}"] = {**read, "sigma": float(f"{sigma:.4g}")}
    return {
        **common,
        "uncertain": free,
        "mode": "prescribed",
        "signals": signals,
        "inputs": dict.fromkeys(given, "position"),
    }


def _reach(rig: Rig) -> Array:
    """Farthest way (driven,) [rad or m] from the middle of a motion, within the
    ranges.
    """
    m = rig.model
    slides = m.jnt_type[rig.driven] == mujoco.mjtJoint.mjJNT_SLIDE
    reach = np.where(slides, SLIDE, REACH)
    inside = np.minimum(reach, INSIDE * np.ptp(m.jnt_range[rig.driven], axis=1))
    return np.where(m.jnt_limited[rig.driven] > 0, inside, reach)


def _places(rig: Rig, rng: np.random.Generator, pace: float | None) -> Array:
    """Wanted joint positions (k, driven) [rad or m] per step: a swing within the
    ranges.
    """
    m, n, reach = rig.model, len(rig.driven), _reach(rig)
    low, high = m.jnt_range[rig.driven].T
    limited, start = m.jnt_limited[rig.driven] > 0, m.qpos0[m.jnt_qposadr[rig.driven]]
    inside = np.clip(start, low + 1.2 * reach, high - 1.2 * reach)
    rates, phases = 1.5 + 0.6 * rng.random((2, n)), rng.uniform(0.0, 6.3, (2, n))
    pace = float(rng.uniform(0.6, 1.4)) if pace is None else pace
    t = pace * (np.arange(round((SPAN + SETTLE) / STEP)) * STEP - SETTLE)[:, None]
    begin = np.clip(1.0 + t / SETTLE, 0.0, 1.0)
    smooth = begin**3 * (10 - 15 * begin + 6 * begin**2)
    swing = np.sin(rates[0] * t + phases[0]) + 0.5 * np.sin(
        1.7 * rates[1] * t + phases[1]
    )
    middle = np.where(limited, inside, start)
    return np.asarray(start + smooth * (middle + reach * swing / 1.5 - start))


def _simulate(rig: Rig, wanted: Array, delay: float = 0.0) -> Motion:
    """Motion to `wanted` places.

    Torques are what a servo needs along the motion, or what commands give `delay` [s]
    late.
    """
    m, data, forward = rig.model, mujoco.MjData(rig.model), rig.mode == "forward"
    at, dofs = m.jnt_qposadr[rig.driven], m.jnt_dofadr[rig.driven]
    begun = SETTLE
    if m.joint(0).name == ROCKING:  # its record begins at rest, as it leans
        begun = 0.0
        mujoco.mj_forward(m, data)
        data.qpos[0] -= data.qfrc_bias[0] / m.jnt_stiffness[0]
    rows, inertia, commands = [], np.zeros((m.nv, m.nv)), [np.zeros(m.nu)]
    for k, (place, rate) in enumerate(
        zip(wanted, np.gradient(wanted, STEP, axis=0), strict=True)
    ):
        if k % EVERY == 0:
            mujoco.mj_fullM(m, data, inertia)
        if not forward or k % EVERY == 0:
            error = SERVO**2 * (place - data.qpos[at]) + 2.0 * SERVO * (
                rate - data.qvel[dofs]
            )
            force = (
                inertia[np.ix_(dofs, dofs)] @ error
                + (data.qfrc_bias - data.qfrc_passive)[dofs]
            )
            force += m.dof_frictionloss[dofs] * np.tanh(rate / CREEP)
        if forward and k % EVERY == 0:
            commands.append(_command(rig, place, force))
        if forward:
            late = min(len(commands) - 1, 1 + round((k - round(delay / STEP)) // EVERY))
            data.ctrl[:] = commands[max(late, 0)]
        else:
            data.qfrc_applied[dofs] = force
        mujoco.mj_step1(m, data)
        if k % EVERY == 0:
            torque = data.qfrc_actuator[dofs] if forward else force
            rows.append((k * STEP - begun, data.qpos.copy(), torque, commands[-1]))
        mujoco.mj_step2(m, data)
        for _ in range(FINER - 1 if forward else 0):
            mujoco.mj_step(m, data)
    kept = [row for row in rows if row[0] >= 0.0]
    return Motion(*map(np.array, zip(*kept, strict=True)))


def _command(rig: Rig, place: Array, force: Array) -> Array:
    """Commands (actuators,) that take the driven joints to a `place`, or give a motor's
    `force`.
    """
    m, u = rig.model, np.zeros(rig.model.nu)
    servo = m.actuator_biasprm[rig.actuators, 1] != 0.0
    unit = rig.gear * m.actuator_gainprm[rig.actuators, 0]
    u[rig.actuators] = np.where(servo, place, force / unit)
    return np.where(m.actuator_ctrllimited > 0, np.clip(u, *m.actuator_ctrlrange.T), u)


def _measured(
    motion: Motion, rig: Rig, rng: np.random.Generator, share: float
) -> dict[str, Array]:
    """Columns (n,) as a data logger writes them, with the `share` of the stated
    noise.
    """
    m, n, forward = rig.model, len(motion.t), rig.mode == "forward"
    noise = share * rng.normal(0.0, ANGLE, (m.njnt, n)).T
    joints = motion.joints + noise
    noise = 0.25 * TORQUE * rng.standard_normal((len(rig.driven), n)).T
    torques = (motion.torques + share * noise * rig.weight) / rig.gear
    names = [f"q{i + 1}" if forward else m.joint(i).name for i in range(m.njnt)]
    names += [f"t{i + 1}" for i in range(len(rig.driven))]
    readings = [*joints.T, *torques.T]
    if forward:
        names += [m.actuator(i).name for i in range(m.nu)]
        readings += [*motion.commands.T]
    return {"t": motion.t, **dict(zip(names, readings, strict=True))}
