"""Computes how effects of the cell's own arm move its gripper, and patches cell.yaml for them."""

from collections.abc import Mapping

import mujoco
import numpy as np

from cell.gap.subject.mechanism.bodies import tip
from cell.gap.subject.mechanism.effect import Readings
from cell.gap.subject.mechanism.load import Opened
from drivers.types import Array

# N m/rad of the robot's joint impedance. Source: setJointImpedance in libfranka's examples.
STIFFNESS = np.array([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
FIELDS = {"payload": "fci.tool", "control_delay": "twin.arm.robot_delay"}  # of cell.yaml


def shift(opened: Opened, q: Array, predicted: tuple[Array, Array], readings: Readings) -> Array:
    """Distances (k,) [m] by which an effect moves the tip at measured joints `q` (k, 7) [rad].

    `predicted` are torques (7, k) [N m] and tracking (7, k) [rad] with an effect less those
    without; torques that the robot does not expect push its joints out by its STIFFNESS.
    """
    torque, tracking = predicted
    names = [joint.name for joint in opened.mechanism.joints]
    bias = np.array([readings.bias.get(name, 0.0) for name in names])
    scale = 1.0 + np.array([readings.scale.get(name, 0.0) for name in names])
    true = (q - bias) / scale - torque.T / STIFFNESS + tracking.T
    return np.asarray(np.linalg.norm(_tips(opened, q) - _tips(opened, true), axis=1))


def _tips(opened: Opened, q: Array) -> Array:
    """Positions (k, 3) [m] of the tip for joint angles `q` (k, 7) [rad]."""
    model = opened.mechanism.model
    data, number = mujoco.MjData(model), model.site("tip").id
    found = np.empty((len(q), 3))
    for k, joints in enumerate(q):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        found[k] = data.site_xpos[number]
    return found


def sentences(name: str, shifts: Array) -> list[str]:
    """Sentences for the operator on the effect `name` that moves the tip by `shifts` (k,) [m]."""
    rms = float(np.sqrt(np.mean(shifts**2)))
    moves = f"{name}: the gripper stands up to {1e3 * shifts.max():.2f} mm (rms {1e3 * rms:.2f})"
    if name in FIELDS:
        where = f"`cell gap accept` puts it into cell.yaml, {FIELDS[name]}"
    else:
        where = "cell.yaml has no field for it: `cell gap accept` puts it into the arm's model only"
    return [f"{moves} from where the model has it, in these runs", f"{name}: {where}"]


def cell_patch(
    opened: Opened, base: Mapping[str, float], effects: Mapping[str, Mapping[str, float]]
) -> dict[str, object] | None:
    """Patch of cell.yaml for accepted effects, the tool's load and the arm's delay; else None."""
    found: dict[str, object] = {}
    delay = effects.get("control_delay", {}).get("time", base.get("control_delay.time"))
    if delay is not None:
        found["twin"] = {"arm": {"robot_delay": round(delay, 4)}}
    if "payload" in effects:
        found["fci"] = {"tool": _tool(opened, effects["payload"]["mass"])}
    return {"effects": {}, **found} if found else None


def _tool(opened: Opened, mass: float) -> dict[str, object]:
    """Mass [kg] and centre of mass [m in the flange] of the hand with a load at the tip."""
    model = opened.mechanism.model
    hand, last = model.body("hand").id, model.body("link7").id
    hand_mass, centre = float(model.body_mass[hand]), np.array(model.body_ipos[hand])
    moment = hand_mass * centre + mass * tip(opened.mechanism, last)
    both = moment / (hand_mass + mass) - model.site("flange").pos
    return {"mass": round(hand_mass + mass, 4), "centre": [round(float(x), 5) for x in both]}
