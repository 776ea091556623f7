"""The cell's own arm: its effects move the gripper, and some have a place in
cell.yaml.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.effect import readings_of
from cell.gap.subject.mechanism.effects import library, ordered_values
from cell.gap.subject.mechanism.inverse_dynamics import InverseDynamics
from cell.gap.subject.mechanism.model import poses, tip
from cell.gap.subject.mechanism.motion import true_motion
from cell.gap.subject.subject import FitRun, NamedValues
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array

# N m/rad of the robot's joint impedance. Source: setJointImpedance in libfranka's
# examples.
STIFFNESS = np.array([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
# of cell.yaml
FIELDS = {"payload": "fci.tool", "control_delay": "twin.arm.robot_delay"}


class CellArm(InverseDynamics):
    """The cell's own robot arm as a mechanism, whose joint torques are predicted by
    inverse dynamics along its measured motion.
    """

    def patch(
        self, base: Mapping[str, float], effects: NamedValues, source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """Content of the arm's refitted file, and the patch of the cell file, which
        holds the mass that the arm carries and the delay of its commands, where these
        were fitted.
        """
        content, _ = super().patch(base, effects, source)
        found: dict[str, object] = {}
        refitted = base.get("control_delay.time")
        delay = effects.get("control_delay", {}).get("time", refitted)
        if delay is not None:
            found["twin"] = {"arm": {"robot_delay": round(delay, 4)}}
        if "payload" in effects:
            found["fci"] = {"tool": self._tool(effects["payload"]["mass"])}
        return content, {"effects": {}, **found} if found else None

    def _tool(self, mass: float) -> dict[str, object]:
        """Mass [kg] and centre of mass [m, frame of the flange] of the robot's hand
        with a point load `mass` [kg] at its tip.
        """
        model = self.mechanism.model
        hand = model.body("hand")
        _, end = tip(model)
        own = float(hand.mass[0])
        whole = own + mass
        moment = own * hand.ipos + mass * end
        centre = moment / whole - model.site("flange").pos
        return {"mass": round(whole, 4), "centre": centre.round(5).tolist()}

    def consequences(
        self, base: Mapping[str, float], effects: NamedValues
    ) -> Sequence[str]:
        """Sentences on how far each of the given effects moves the gripper, and into
        which file `cell gap accept` writes it.
        """
        sentences: list[str] = []
        for name, values in effects.items():
            ordered = ordered_values(library()[name], self.mechanism, values)
            moved = np.concatenate(
                [self._moved_by(name, ordered, run, base) for run in self.runs]
            )
            where = (
                "cell.yaml has no field for it: `cell gap accept` puts it into the"
                " arm's model only"
            )
            if name in FIELDS:
                where = f"`cell gap accept` puts it into cell.yaml, {FIELDS[name]}"
            rms = np.sqrt(np.mean(moved**2))
            sentences += [
                f"{name}: the gripper stands up to {1e3 * moved.max():.2f} mm (rms"
                f" {1e3 * rms:.2f}) from where the model has it, in these runs",
                f"{name}: {where}",
            ]
        return sentences

    def _moved_by(
        self, name: str, values: Array, run: FitRun, base: Mapping[str, float]
    ) -> Array:
        """Distances [m] by which the effect `name` alone moves the gripper, one for
        each reading of a run.

        A torque that the robot does not expect deflects a joint by torque / STIFFNESS.
        """
        about = np.array([base.get(p.name, p.start) for p in self.scope.base])
        cases = [
            self._case(replace(self.stated(run, effects), base=about))
            for effects in ({name: values}, {})
        ]
        with_effect, without = self.predict(cases)
        torque, tracking = np.split(with_effect - without, [len(self._sensors)])
        content = cases[0].content
        model = self.mechanism.model
        motion = content.motion
        t = content.cut.t
        readings = readings_of([(library()[name], values)])._replace(delay=0.0)
        true, *_ = true_motion(motion, readings)
        q, at = (interpolate_columns(t, motion.t, x) for x in (motion.q, true))
        at = at - torque.T / STIFFNESS + tracking.T
        moved, stated = (case.edited(model) for case in cases)
        apart: Array = np.linalg.norm(_tips(stated, q) - _tips(moved, at), axis=1)
        return apart


def _tips(model: Any, q: Array) -> Array:
    """Positions [m] of the tip of a `model`, one row of three coordinates for each row
    of seven joint angles `q` [rad].
    """
    places = [
        data.site("tip").xpos.copy() for data in poses(model, q, mujoco.mj_kinematics)
    ]
    return np.array(places)
