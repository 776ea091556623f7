"""Pendulums: chains of hinges, hanging at zero, that swing freely from a pivot."""

from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.forward_dynamics import (
    DAMPED,
    FLEX,
    LEAST_COMPLIANCE,
    STIFFEST,
    ForwardDynamics,
    SplitModel,
)
from cell.gap.subject.mechanism.subject import Case


class PivotModel(SplitModel):
    """Model of a chain of hinges whose pivot slides sideways on a spring."""

    def _add_flexible_joints(self, spec: Any) -> None:
        """Add a slide at the pivot before the first hinge, for joints move in their order."""
        body, name, axis = spec.joints[0].parent, spec.joints[0].name, spec.joints[0].axis.copy()
        spec.delete(spec.joints[0])
        body.add_joint(name=FLEX, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1.0, 0.0, 0.0))
        body.add_joint(name=name, axis=axis)

    def _set_gears(self, found: Any, edited: Any, case: Case) -> None:
        """Set the stiffness [N/m] and damping of the pivot, and springs as `edited`."""
        mass = float(edited.body_mass.sum())
        compliance = np.maximum(np.asarray(case.readings.elastic), LEAST_COMPLIANCE)
        stiffness = np.minimum(1.0 / compliance, STIFFEST * mass)
        found.jnt_stiffness[self._joint] = edited.jnt_stiffness
        found.jnt_stiffness[self._flex] = stiffness
        found.dof_damping[self._flex_dof] = 2.0 * DAMPED * np.sqrt(stiffness * mass)
        self._set_law_parameters(found, edited)


class Pendulum(ForwardDynamics):
    """Measured swings of a chain of hinges, simulated as a mechanism."""

    believed = False
    split = PivotModel
