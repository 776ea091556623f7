"""Reads a pendulum's file and its measured swings as a mechanism, a chain of hinges."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.effects import check_effects, torques
from cell.gap.subject.mechanism.forward_dynamics import (
    DAMPED,
    FLEX,
    LEAST_COMPLIANCE,
    STIFFEST,
    ForwardDynamics,
    SplitModel,
)
from cell.gap.subject.mechanism.mechanism_file import MechanismFile, PendulumFile
from cell.gap.subject.mechanism.model import PLANAR, TURN, Mechanism, joints_of
from cell.gap.subject.mechanism.model_source import Source, compile_model
from cell.gap.subject.mechanism.patch import accepted_content
from cell.gap.subject.mechanism.read_mechanism import (
    FORWARD_FLOOR,
    BaseParameter,
    MechanismData,
    mechanism_of,
    setter_of,
    zone_of,
)
from cell.gap.subject.mechanism.recordings import Recording, Signal, check_angle
from cell.gap.subject.mechanism.subject import Case
from cell.gap.subject.run_folders import RunFolder, check_indices, check_time, column, read_table
from cell.gap.subject.subject import NamedValues, Parameter
from cell.record.files import RUN
from cell.record.header import SwingRun
from drivers.errors import ConfigurationError
from drivers.settings import load
from drivers.types import Array, frozen

SMALL = 1e-4  # rad of a small swing
SWING_STEP = 0.15  # rad of the fastest small swing in one step
SPARSEST = 0.8  # rad of the fastest small swing between two readings
SLOWEST_CHECKED = 0.1  # rad/s of a swing below which stated rates are not checked
SPREADS = (("com", "m", 0.01), ("inertia", "kg m^2", 0.10), ("length", "m", 0.005))
"""Name, unit and relative prior spread of what was weighed and measured of a link."""


@dataclass(frozen=True, slots=True)
class PendulumData(MechanismData):
    """Pendulum with its file `pendulum`, base parameters and recordings."""

    pendulum: PendulumFile


class PivotModel(SplitModel):
    """Model of a chain of hinges whose pivot slides sideways on a spring."""

    def _add_flexible_joints(self, spec: Any) -> None:
        """Add a slide at the pivot before the first hinge, for joints move in their order."""
        body, name, axis = spec.joints[0].parent, spec.joints[0].name, spec.joints[0].axis.copy()
        spec.delete(spec.joints[0])
        body.add_joint(name=FLEX, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1.0, 0.0, 0.0))
        body.add_joint(name=name, axis=axis)

    def _set_gears(self, found: Any, edited: Any, case: Case) -> None:
        """Set the stiffness [N/m] and damping of the pivot, and lengths and springs as `edited`."""
        mass = float(edited.body_mass.sum())
        compliance = np.maximum(np.asarray(case.readings.elastic), LEAST_COMPLIANCE)
        stiffness = np.minimum(1.0 / compliance, STIFFEST * mass)
        found.body_pos[:] = edited.body_pos
        found.jnt_stiffness[self._joint] = edited.jnt_stiffness
        found.jnt_stiffness[self._flex] = stiffness
        found.dof_damping[self._flex_dof] = 2.0 * DAMPED * np.sqrt(stiffness * mass)
        self._set_law_parameters(found, edited)


class Pendulum(ForwardDynamics):
    """Measured swings of a chain of hinges, simulated as a mechanism."""

    opened: PendulumData
    believed = False
    split = PivotModel

    def patch(
        self, base: Mapping[str, float], effects: NamedValues, source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """Content of the pendulum's file with refitted base and named effects."""
        content = self.opened.pendulum.model_dump(mode="json", by_alias=True)
        for name, value in base.items():
            if "." not in name:
                key, number = name.rsplit("_", 1)
                content["links"][int(number) - 1][key] = value
        return accepted_content(self.opened, content, base, effects, source), None

    def model_text(self, base: Mapping[str, float], effects: NamedValues) -> str | None:  # noqa: ARG002
        """None, as a pendulum's own file describes its chain."""
        return None


def open_swings(path: Path, folders: Sequence[RunFolder]) -> PendulumData:
    """Pendulum in the file at `path` with its swings; ConfigurationError for broken input."""
    pendulum = load(path, PendulumFile)
    heads = [_read_head(folder.path / RUN, pendulum) for folder in folders]
    fast = open_recordings(path, pendulum, []).mechanism.joints[0].rate
    found = [_read_swing(*pair, len(pendulum.links), fast)
             for pair in zip(folders, heads, strict=True)]  # fmt: skip
    check_indices([f.path for f in folders], [r.index for r in found])
    return open_recordings(path, pendulum, sorted(found, key=lambda r: r.index or 0))


def open_recordings(path: Path, pendulum: PendulumFile, found: Sequence[Recording]) -> PendulumData:
    """Mechanism of a pendulum with its recordings, base parameters and signals.

    Raises ConfigurationError for effects that the library lacks.
    """
    source, n = Source(pendulum.xml()), len(pendulum.links)
    model = compile_model(source, str(path), torques().slots, 0.01)
    fast = _fastest(model)
    names = [str(i + 1) for i in range(n)]
    described = MechanismFile.model_validate({
        "schema": 1, "kind": "mechanism", "name": pendulum.name, "model": "",
        "step": SWING_STEP / fast, "effects": pendulum.effects,
        "signals": {name: {"sensor": name, "sigma": 1.0} for name in names},
    })  # fmt: skip
    model.opt.timestep = described.step
    sums = np.tri(n)  # absolute angles are sums of the joints'
    signals = tuple(Signal(name, "position", 0.0, zone_of(i, n), i, sums[i], FORWARD_FLOOR, "angle")
                    for i, name in enumerate(names))  # fmt: skip
    joints = joints_of(model, dict.fromkeys(names, (fast, 0.0, TURN)), {})
    mechanism = mechanism_of(PLANAR, described.step, source, model, joints, signals)
    check_effects(pendulum.effects, mechanism, str(path))
    return PendulumData(described, path, mechanism, tuple(_base(pendulum, mechanism)),
                        tuple(found), 0.5 * fast, pendulum)  # fmt: skip


def _fastest(model: Any) -> float:
    """Angular frequency [rad/s] of the fastest small oscillation of a chain that hangs at zero."""
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    pull = []
    for angles in SMALL * np.eye(model.nv):
        data.qpos[:] = angles
        mujoco.mj_forward(model, data)
        pull.append(data.qfrc_bias / SMALL)
    return float(np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, np.array(pull))).real.max()))


def _base(pendulum: PendulumFile, mechanism: Mechanism) -> list[BaseParameter]:
    """Base parameters: damping, centre of mass and inertia of links, length of all but the last."""
    found = []
    for i, (link, joint) in enumerate(zip(pendulum.links, mechanism.joints, strict=True)):
        most = joint.torque / joint.rate  # its links would hardly swing
        parameter = Parameter(f"damping_{i + 1}", "N m s", link.damping, 0.0, most,
                              step=1e-5 * most, spread=0.1 * most)  # fmt: skip
        found.append(BaseParameter(parameter, setter_of("dof_damping", (i,))))
    # field, its first row, place in a row, sign; links point down, body 0 is the world
    places = {"com": ("body_ipos", 1, 2, -1.0), "inertia": ("body_inertia", 1, slice(None), 1.0),
              "length": ("body_pos", 2, 2, -1.0)}  # fmt: skip
    for key, unit, spread in SPREADS:
        field, first, at, sign = places[key]
        for i, link in enumerate(pendulum.links[:-1] if key == "length" else pendulum.links):
            v = float(getattr(link, key))
            parameter = Parameter(f"{key}_{i + 1}", unit, v, 0.2 * v, 5.0 * v,
                                  step=1e-3 * spread * v, spread=spread * v)  # fmt: skip
            found.append(BaseParameter(parameter, setter_of(field, (i + first, at), sign)))
    return found


def _read_head(path: Path, pendulum: PendulumFile) -> SwingRun:
    """Read the header of a swing; raises ConfigurationError, in one line, for a broken one."""
    head = load(path, SwingRun)
    if head.pendulum != pendulum.name:
        raise ConfigurationError(
            f"{path}: pendulum: is {head.pendulum!r}, but the file describes "
            f"{pendulum.name}; give runs of one pendulum and its file, or its strip file"
        )
    if head.sigma.angle is None:
        raise ConfigurationError(f"{path}: sigma.angle: is missing; add the noise in rad")
    return head


def _read_swing(folder: RunFolder, head: SwingRun, n: int, fast: float) -> Recording:
    """Read the swing in `folder` of `n` links; raises ConfigurationError for a broken one."""
    path = folder.path / "angles.parquet"
    table = read_table(path)
    t = column(table, "t", path)
    check_time(t, path, least=30)
    angles = [column(table, f"theta_{i + 1}", path) for i in range(n)]
    if f"theta_{n + 1}" in table:
        raise ConfigurationError(f"{path}: theta_{n + 1}: {head.pendulum} has {n} links only")
    for i, angle in enumerate(angles):
        check_angle(t, angle, path, f"theta_{i + 1}")
    rates = None
    if all(f"omega_{i + 1}" in table for i in range(n)):
        rates = np.array([column(table, f"omega_{i + 1}", path) for i in range(n)])
        _check_rates(np.gradient(angles, t, axis=1), rates, path)
    step = float(np.median(np.diff(t)))
    if step > SPARSEST / fast:
        raise ConfigurationError(
            f"{path}: t: rows are {step:g} s apart, at most {SPARSEST / fast:.2g} s shows this "
            "pendulum's swings; t is in s"
        )
    hanging = {str(i): frozen(angle - np.pi) for i, angle in enumerate(angles, start=1)}
    return Recording(
        folder.name, str(head.condition or folder.name), head.index, frozen(t - t[0]), hanging,
        sigma=head.sigma.angle, rates=None if rates is None else rates[:, 0],
    )  # fmt: skip


def _check_rates(slope: Array, rates: Array, path: Path) -> None:
    """Refuse stated rates (n, m) [rad/s] unlike the measured angles' `slope` (n, m) [rad/s]."""
    if float(np.quantile(np.abs(slope), 0.99)) < SLOWEST_CHECKED:
        return
    ratio = float((rates * slope).sum() / (slope * slope).sum())
    if not 0.5 < ratio < 2.0:
        raise ConfigurationError(
            f"{path}: omega: is {ratio:.3g} times the rate of theta; t is in s, angles in rad, "
            "rates in rad/s"
        )
