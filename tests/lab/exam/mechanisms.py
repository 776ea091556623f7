"""Makes runs of simulated mechanisms with one hidden cause, by another integrator and step.

Chains of motors on hinges, or a pendulum on a cart; damping and the last mass differ from run to
run. Torques are read with noise; what is measured is written as runs beside the mechanism's file.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from drivers.files import replace_file
from drivers.types import Array
from drivers.yaml_text import dump_yaml
from tests.support.mechanisms import write_run

RUNS, SPAN, STEP, EVERY = 8, 4.0, 4e-4, 10  # number, s, s, steps per reading
LINK, CENTRE = 0.3, 0.15  # m, length of a link and distance of its centre of mass from its joint
JOINT_DAMPING, JOINT_ARMATURE = 0.05, 0.01  # s, s^2 (per m on a slide), of the weight it bears
SIDE_INERTIA, AXIAL_INERTIA = 0.008, 0.001  # m^2: of a link across and along it, of its mass
TAPER = 0.7  # mass of a link over that of the one before
ANGLE, TORQUE = 3e-4, 0.02  # rad, share of a joint's weight: one sigma of a reading
STIFF = 3e4  # 1/rad: gain of a servo that follows its command to 0.02 mrad, of the weight it bears
SERVO = 12.0  # 1/rad: gain of other servos, of the weight they bear
# causes at size one: s, rad under a joint's weight; shares of weight, constant, last mass; rad
DELAY, TWIST = 0.006, 0.02
BIAS, CONSTANT_ERROR, LOAD_SHARE, ENCODER_BIAS = 0.06, 0.15, 0.15, 0.05
Columns = dict[str, Array]


@dataclass(frozen=True, slots=True)
class Chain:
    """Chain of links on motorised `joints`, the first of which may be the slide of a `cart`.

    `weight` (joints,) [N m or N] is gravity's typical load; a motor's gain is `gain` times that.
    """

    joints: int
    cart: bool
    gain: float
    weight: Array

    @classmethod
    def of(cls, joints: int, *, cart: bool, gain: float = SERVO) -> "Chain":
        """Chain of links of equal length, each lighter than the one before, and its weights."""
        masses = 1.0 * TAPER ** np.arange(joints)
        places = LINK * np.arange(joints) + CENTRE
        weight = [9.81 * float(masses[i:] @ (places[i:] - LINK * i)) for i in range(joints)]
        if cart:
            weight[0] = 9.81 * float(masses.sum())
        return cls(joints, cart, gain, np.array(weight))

    def xml(self) -> str:
        """MJCF text of the chain as its owner knows it, without the hidden cause."""
        bodies = "".join(self._body(i) for i in range(self.joints))
        ends = "</body>" * self.joints
        motors = "".join(self._motor(i) for i in range(self.joints))
        return (
            '<mujoco model="chain"><compiler angle="radian"/><option integrator="RK4"/>'
            f"<worldbody>{bodies}{ends}</worldbody><actuator>{motors}</actuator></mujoco>\n"
        )

    def _body(self, i: int) -> str:
        """Link `i` with its joint in MJCF; the element stays open for the next link."""
        kind = "slide" if self.cart and i == 0 else "hinge"
        at_base = i == 0 or (self.cart and i == 1)  # a cart carries its first link on its joint
        place = "" if at_base else f' pos="0 0 -{LINK}"'
        mass, weight = TAPER**i, self.weight[i]
        across, along = SIDE_INERTIA * mass, AXIAL_INERTIA * mass
        return (
            f'<body name="link{i + 1}"{place}><joint name="j{i + 1}" axis="{self._joint_axis(i)}" '
            f'type="{kind}" damping="{JOINT_DAMPING * weight:.6g}" '
            f'armature="{JOINT_ARMATURE * weight:.6g}"/>'
            f'<inertial pos="0 0 -{CENTRE}" mass="{mass:.6g}" '
            f'diaginertia="{across:.6g} {across:.6g} {along:.6g}"/>'
            f'<site name="s{i + 1}" pos="0 0 -{LINK}"/>'
        )

    def _joint_axis(self, i: int) -> str:
        """Axis of joint `i` in MJCF: y and x in turn, but a cart slides along x, under a y."""
        along_x = i % 2 == 1
        if self.cart and i < 2:
            along_x = i == 0
        return "1 0 0" if along_x else "0 1 0"

    def _motor(self, i: int) -> str:
        """Position servo of joint `i` in MJCF."""
        gain = self.gain * self.weight[i]
        return f'<position name="a{i + 1}" joint="j{i + 1}" kp="{gain:.6g}"/>'

    def file(self, *, tracking: bool) -> dict[str, Any]:
        """Content of the chain's mechanism file, with signals of tracking if `tracking`."""
        names = range(1, self.joints + 1)
        signals: dict[str, Any] = {
            f"t{i}": {"actuator": f"a{i}", "is": "torque",
                      "sigma": round(TORQUE * float(self.weight[i - 1]), 6)}
            for i in names
        }  # fmt: skip
        if tracking:
            signals |= {f"e{i}": {"joint": f"j{i}", "is": "tracking", "sigma": ANGLE}
                        for i in names}  # fmt: skip
        return {"schema": 1, "kind": "mechanism", "name": "chain", "model": "chain.xml",
                "mode": "prescribed", "signals": signals,
                "inputs": {f"j{i}": "position" for i in names},
                "uncertain": [{"joint": "*", "field": "damping", "spread": "50%"},
                              {"body": "*", "field": "mass", "spread": "1%"},
                              {"body": "*", "field": "com", "spread": 0.002}]}  # fmt: skip


Edit = Callable[[Any, Chain, float], None]
Reading = Callable[[Columns, Chain, float, np.random.Generator], None]


def _payload(m: Any, _c: Chain, s: float) -> None:
    """Hidden payload: a point mass at the end of the last link, CENTRE beyond its centre."""
    last, mass = m.nbody - 1, float(m.body_mass[m.nbody - 1])
    payload = LOAD_SHARE * s * mass
    whole = mass + payload
    m.body_ipos[last, 2] -= CENTRE * payload / whole
    m.body_inertia[last, :2] += CENTRE**2 * payload * mass / whole
    m.body_mass[last] = whole


def _bend_link(m: Any, _c: Chain, s: float) -> None:
    """Foreign cause: a link that is bent and twisted, so that the last joint's axis is skewed.

    It is bent across the axis: a bend about the axis would look like an encoder's bias.
    """
    turn = np.zeros(4)
    x, y, _ = m.jnt_axis[-1]
    mujoco.mju_axisAngle2Quat(turn, np.array([0.6 * y, -0.6 * x, 0.8]), 0.25 * s)
    m.body_quat[-1] = turn


def _constant(columns: Columns, c: Chain, s: float, _: np.random.Generator) -> None:
    """Hidden error of motor constants, larger than stated, which are known to 10 to 20 %."""
    for i in range(c.joints):
        columns[f"t{i + 1}"] /= 1.0 + CONSTANT_ERROR * s


def _torque_bias(columns: Columns, c: Chain, s: float, _: np.random.Generator) -> None:
    for i in range(c.joints):
        columns[f"t{i + 1}"] += (-1) ** i * BIAS * s * c.weight[i]


def _encoder_bias(columns: Columns, c: Chain, s: float, _: np.random.Generator) -> None:
    columns[f"j{c.joints}"] += ENCODER_BIAS * s


def _bolt(columns: Columns, c: Chain, s: float, _: np.random.Generator) -> None:
    """Foreign cause: a loose bolt, a gap of the last joint that opens where its load is large."""
    load = columns[f"t{c.joints}"] / c.weight[-1]
    columns[f"j{c.joints}"] += 0.06 * s * np.sign(load) * (np.abs(load) > 0.25)


def _cable(columns: Columns, c: Chain, s: float, _: np.random.Generator) -> None:
    """Foreign cause: a cable that catches at one angle of the last joint, and pulls only there."""
    angle = columns[f"j{c.joints}"]
    columns[f"t{c.joints}"] += 0.3 * s * c.weight[-1] * np.exp(-(((angle - 0.2) / 0.08) ** 2))


def _supply(columns: Columns, c: Chain, s: float, rng: np.random.Generator) -> None:
    """Foreign cause: a supply voltage that wanders, and torques estimated from currents with it."""
    steps = rng.standard_normal(8)
    t = columns["t"]
    slow = np.interp(t, np.linspace(0.0, t[-1], 8), steps)
    for i in range(c.joints):
        columns[f"t{i + 1}"] *= 1.0 + 0.08 * s * slow


EDITS: Mapping[str, Edit] = {"payload": _payload, "bent_link": _bend_link}
FIELDS = {  # MuJoCo's field, the library's parameter, and share of a joint's weight at size one
    "dry_friction": ("dof_frictionloss", "torque", 0.06),
    "quadratic_damping": ("dof_dampingpoly", "coefficient", 0.03),
    "cable_spring": ("jnt_stiffness", "stiffness", 0.15),
    "armature": ("dof_armature", "inertia", 0.01),
}
READINGS: Mapping[str, Reading] = {
    "torque_bias": _torque_bias, "torque_constant": _constant, "encoder_bias": _encoder_bias,
    "loose_bolt": _bolt, "catching_cable": _cable, "wandering_supply": _supply,
}  # fmt: skip
TRACKED = ("control_delay", "joint_elasticity")
OUTSIDE = ("loose_bolt", "catching_cable", "wandering_supply", "bent_link")


def amounts(hidden: str, joints: int, size: float, *, cart: bool = False) -> dict[str, float]:
    """True values of the library's parameters for `hidden` at `size`; none for foreign causes."""
    weight = Chain.of(joints, cart=cart).weight
    names = [f"j{i + 1}" for i in range(joints)]
    each = {name: (key, share * weight) for name, (_, key, share) in FIELDS.items()}
    each |= {"joint_elasticity": ("compliance", TWIST / weight),
             "torque_bias": ("torque", -BIAS * (-1.0) ** np.arange(joints) * weight),
             "torque_constant": ("error", CONSTANT_ERROR * np.ones(joints))}  # fmt: skip
    if hidden in each:
        key, values = each[hidden]
        return {f"{key}_{n}": size * float(v) for n, v in zip(names, values, strict=True)}
    single = {"payload": ("mass", LOAD_SHARE * TAPER ** (joints - 1)),
              "control_delay": ("time", DELAY),
              "encoder_bias": (f"bias_{names[-1]}", ENCODER_BIAS)}  # fmt: skip
    return {key: size * value for name, (key, value) in single.items() if name == hidden}


def make_runs(
    folder: Path, hidden: str, joints: int, size: float, seed: int, *, cart: bool = False
) -> Path:
    """Write runs with the cause `hidden` to `folder`/runs; returns the mechanism's file."""
    rng, tracked = np.random.default_rng(seed), hidden in TRACKED
    chain = Chain.of(joints, cart=cart, gain=STIFF if tracked else SERVO)
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(folder / "chain.xml", chain.xml().encode())
    file = folder / "chain.yaml"
    replace_file(file, dump_yaml(chain.file(tracking=tracked)).encode())
    for k in range(RUNS):
        model = _model_with(hidden, chain, size)
        model.dof_damping[:] *= 1.0 + 0.02 * rng.standard_normal(joints)
        columns = _simulate_motion(model, chain, hidden, size, float(rng.uniform(0.5, 1.5)), rng)
        if hidden in READINGS:
            READINGS[hidden](columns, chain, size, rng)
        for i in range(joints):
            columns[f"j{i + 1}"] += rng.normal(0.0, ANGLE, len(columns["t"]))
            noise = rng.normal(0.0, 0.5 * TORQUE * chain.weight[i], len(columns["t"]))
            columns[f"t{i + 1}"] += noise
            columns[f"e{i + 1}"] = columns[f"j{i + 1}"] - columns.pop(f"c{i + 1}")
        write_run(folder / "runs" / f"{k:02d}", columns, {"mechanism": "chain", "index": k})
    return file


def _model_with(hidden: str, chain: Chain, size: float) -> Any:
    """Compiled model of a chain with the cause `hidden`, where that is in the model."""
    model = mujoco.MjModel.from_xml_string(chain.xml())
    model.opt.timestep = STEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if hidden in FIELDS:
        field, _, share = FIELDS[hidden]
        getattr(model, field).reshape(chain.joints, -1)[:, 0] += share * size * chain.weight
    if hidden in EDITS:
        EDITS[hidden](model, chain, size)
    return model


def _simulate_motion(
    model: Any, chain: Chain, hidden: str, size: float, pace: float, rng: np.random.Generator
) -> Columns:
    """Columns (m,) of a motion there and back: time `t`, joints `j1`, torques `t1`, commands `c1`.

    Behind an elastic gear, the link swings on a spring, with its motor at the command.
    """
    data, rows, n = mujoco.MjData(model), list[Array](), chain.joints
    delay = DELAY * size if hidden == "control_delay" else 0.0
    if hidden == "joint_elasticity":  # the servo's gain is the gear's stiffness: the link springs
        stiffness = chain.weight / (TWIST * size)
        model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1] = stiffness, -stiffness
    rates = pace * (1.5 + 0.6 * rng.random((2, n)))
    phases = rng.uniform(0.0, 6.3, (2, n))
    reach = 0.5 * 0.85 ** np.arange(n)

    def command(t: float) -> Array:
        begin = min(max(t, 0.0) / 0.5, 1.0)  # 0 to 1 smoothly, in half a second
        swing = np.sin(rates[0] * t + phases[0]) + 0.5 * np.sin(1.7 * rates[1] * t + phases[1])
        return np.asarray(reach * begin**3 * (10 - 15 * begin + 6 * begin**2) * swing)

    for k in range(round(SPAN / STEP)):
        data.ctrl[:] = command(data.time - delay)
        if k % EVERY == 0:
            mujoco.mj_forward(model, data)
            force = data.actuator_force.copy()
            rows.append(np.concatenate([[data.time], data.qpos, force, command(data.time)]))
        mujoco.mj_step(model, data)
    columns = np.array(rows).T
    names = ["t", *(f"{key}{i + 1}" for key in "jtc" for i in range(n))]
    return {name: np.array(column) for name, column in zip(names, columns, strict=True)}
