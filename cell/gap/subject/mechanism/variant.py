"""Builds models with elastic gears or play: each joint is split into motor and link."""

import copy
import xml.etree.ElementTree as ET
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.case import Case, ModelFields
from cell.gap.subject.mechanism.model import Mechanism, compile_model
from drivers.types import Array

FLEX = "__flex"
SHARE = 1e-3  # of a joint's inertia that its motor has where the model states none
DAMPED = 0.02  # of critical damping, in the gear
STIFFEST = 1e6  # N m/rad per kg m^2 of a joint's inertia, of a gear that does not twist
LEAST_COMPLIANCE = 1e-12  # rad/(N m), against division by zero
BODY = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
DOF = ("dof_damping", "dof_dampingpoly", "dof_armature", "dof_frictionloss")
ACTUATOR = ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange")


class Variant:
    """Model of a mechanism with each joint split; `motor` (joints,) are indices of motor states."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        base = mechanism.model
        self._model = compile_model(_split(mechanism), "variant", base.nuser_jnt, mechanism.step)
        self._model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        if hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"):
            self._model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
        names = [j.name for j in mechanism.joints]
        self._joint = np.array([self._model.joint(n).id for n in names])
        self._flex = np.array([self._model.joint(n + FLEX).id for n in names])
        self._body = np.array([self._model.body(n).id for n in _body_names(base)])
        self.motor: Array = self._model.jnt_dofadr[self._joint]

    def model(self, case: Case, *, rigid: bool) -> Any:
        """Model of a case, split, or its `rigid` twin with the same integrator."""
        edited = copy.copy(self._mechanism.model)
        fields = ModelFields(edited)
        case.edit(fields)
        fields.finish()
        if rigid:
            edited.opt.integrator = self._model.opt.integrator
            mujoco.mj_setConst(edited, mujoco.MjData(edited))
            return edited
        found = copy.copy(self._model)
        for name in BODY:
            getattr(found, name)[self._body] = getattr(edited, name)
        for name in DOF:
            getattr(found, name)[self.motor] = getattr(edited, name)
        for name in ACTUATOR:
            getattr(found, name)[:] = getattr(edited, name)
        self._set_gears(found, edited, case)
        mujoco.mj_setConst(found, mujoco.MjData(found))
        return found

    def _set_gears(self, found: Any, edited: Any, case: Case) -> None:
        """Write stiffness, play and values of compiled torques to the split joints of `found`."""
        inertia = self._mechanism.inertia
        dof = self._model.jnt_dofadr[self._flex]
        elastic, gap = case.readings.elastic, case.readings.gap
        compliance = np.zeros(len(inertia)) if elastic is None else elastic
        stiffness = np.minimum(1.0 / np.maximum(compliance, LEAST_COMPLIANCE), STIFFEST * inertia)
        found.jnt_stiffness[self._joint] = edited.jnt_stiffness
        found.qpos_spring[self.motor] = edited.qpos_spring
        motor_inertia = np.maximum(found.dof_armature[self.motor], SHARE * inertia)
        found.dof_armature[self.motor] = motor_inertia
        if gap is not None and np.any(gap):
            has_play = gap > 0.0
            stiffness = np.where(has_play, 0.0, stiffness)
            found.jnt_range[self._flex] = 0.5 * np.outer(gap, (-1.0, 1.0)) * has_play[:, None]
            found.jnt_limited[self._flex] = has_play
        found.jnt_stiffness[self._flex] = stiffness
        found.dof_damping[dof] = 2.0 * DAMPED * np.sqrt(np.maximum(stiffness, 1.0) * motor_inertia)
        found.jnt_user[:] = 0.0
        found.jnt_user[self._joint] = edited.jnt_user
        # what `passive.HEAD` describes, for the split joints
        found.jnt_user[:, 0] = found.njnt
        found.jnt_user[:, 1], found.jnt_user[:, 2] = found.jnt_qposadr, found.jnt_dofadr
        found.jnt_user[:, 3] = float(np.mean(edited.jnt_user[:, 3]))


def _body_names(model: Any) -> list[str]:
    """Names of all bodies in order; a body without a name is called by its number."""
    return [model.body(i).name or f"body{FLEX}_{i}" for i in range(model.nbody)]


def _split(mechanism: Mechanism) -> str:
    """MJCF text of the model with a flexible joint between each joint and its body."""
    spec = mujoco.MjSpec.from_string(mechanism.xml)
    root = ET.fromstring(spec.to_xml())  # noqa: S314  our own text
    bodies = list(root.iter("body"))
    for body, name in zip(bodies, _body_names(mechanism.model)[1:], strict=True):
        body.set("name", name)
    for body in bodies:
        joint = body.find("joint")
        if joint is None or not joint.get("name"):
            continue
        inner = ET.Element("body", {k: v for k, v in body.attrib.items() if k == "name"})
        for child in list(body):
            if child is not joint:
                body.remove(child)
                inner.append(child)
        body.set("name", f"{body.get('name', '')}{FLEX}_{joint.get('name')}")
        kept = {k: v for k, v in joint.attrib.items() if k in ("type", "axis", "pos", "class")}
        inner.insert(0, ET.Element("joint", {**kept, "name": joint.get("name", "") + FLEX}))
        inertial = {"pos": "0 0 0", "mass": "1e-6", "diaginertia": "1e-9 1e-9 1e-9"}
        body.insert(0, ET.Element("inertial", inertial))
        body.append(inner)
    return ET.tostring(root, encoding="unicode")
