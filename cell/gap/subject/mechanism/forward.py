"""Simulates runs of a mechanism with MuJoCo, many at once, and reads its sensors."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from cell.gap.subject.interpolate import interpolate
from cell.gap.subject.mechanism.case import BatchFields, Case
from cell.gap.subject.mechanism.effects import torques
from cell.gap.subject.mechanism.load import Opened
from cell.gap.subject.mechanism.runs import Recording
from cell.gap.subject.mechanism.variant import Variant
from drivers.types import Array, frozen

TOGETHER = 256  # simulations of a batch
POSITION_LIMIT = 1e4  # rad or m that no mechanism reaches
TIME_ROUNDING = 1e-9  # s by which a command may be stamped late of the grid
CONST = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_armature", "qpos_spring")


@dataclass(frozen=True, slots=True)
class Commands:
    """Commands `u` (m, actuators) of a run, each held from its time in `t` (m,) [s] on."""

    t: Array
    u: Array

    def at_steps(self, step: float, steps: int, delay: float) -> Array:
        """Mean commands (steps, actuators) within each step, `delay` [s] late."""
        if not self.u.shape[1]:
            return np.zeros((steps, 0))
        edges = np.arange(steps + 1) * step - delay
        ends = np.append(self.t[1:], max(self.t[-1], edges[-1]) + 1.0)  # the last is held
        held = np.cumsum(self.u * (ends - self.t)[:, None], axis=0)
        integral = np.concatenate([np.zeros((1, self.u.shape[1])), held])
        times = np.append(self.t, ends[-1])
        before = np.minimum(edges - self.t[0], 0.0)[:, None] * self.u[0]  # the first is held, too
        total = np.array([np.interp(edges, times, column) for column in integral.T]).T + before
        return np.asarray(np.diff(total, axis=0) / step)


def commands_of(recording: Recording, inputs: Sequence[str], actuators: Sequence[str],
                hold: float | None) -> Commands:  # fmt: skip
    """Commands of `actuators` in a recording, on a grid of `hold` [s] if a controller held them."""
    t = recording.t if hold is None else np.arange(0.0, recording.t[-1] + hold, hold)
    row = np.clip(np.searchsorted(recording.t, t + TIME_ROUNDING, side="right") - 1, 0, None)
    u = np.zeros((len(t), len(actuators)))
    for i, name in enumerate(actuators):
        if name in inputs:
            column = recording.columns[name]
            known = np.isfinite(column)
            u[:, i] = np.interp(recording.t, recording.t[known], column[known])[row]
    return Commands(frozen(t), frozen(u))


class Forward:
    """Predicts a mechanism's signals by simulation, with MuJoCo's forces and `laws`."""

    def __init__(self, opened: Opened, jobs: int, laws: frozenset[str]) -> None:
        self._mechanism, self._signals, self._mix = opened.mechanism, opened.signals, opened.mix
        self._jobs, self._laws = jobs, laws
        self._settle = round((opened.file.start.settle or 0.0) / self._mechanism.step)
        self._variant: Variant | None = None

    def predict(self, cases: Sequence[Case]) -> list[Array | None]:
        """Signals (signals, k) of each case at its readings; None where its simulation is lost."""
        by_motion: dict[Hashable, list[int]] = {}
        for i in sorted(range(len(cases)), key=lambda i: float(cases[i].content.cut.t[-1])):
            by_motion.setdefault(cases[i].motion, []).append(i)
        groups = list(by_motion.values())
        found: dict[int, Array] = {}
        for begin in range(0, len(groups), TOGETHER):
            found |= self._predict_together(cases, groups[begin : begin + TOGETHER])
        return [found.get(i) for i in range(len(cases))]

    def _predict_together(self, cases: Sequence[Case],
                          groups: Sequence[Sequence[int]]) -> dict[int, Array]:  # fmt: skip
        """Signals (signals, k) by number of case, for `groups` of cases that move alike."""
        simulated, control, batch = self._simulate([cases[i] for i, *_ in groups])
        tame = np.abs(simulated).max(axis=(1, 2, 3)) < POSITION_LIMIT
        by_times: dict[tuple[int, float], list[tuple[int, int]]] = {}
        for row, group in enumerate(groups):
            for i in group if tame[row] else ():
                times = id(cases[i].content), cases[i].readings.delay
                by_times.setdefault(times, []).append((row, i))
        found = {}
        for (_, delay), members in by_times.items():
            rows, numbers = zip(*members, strict=True)
            t = np.maximum(cases[numbers[0]].content.cut.t - delay, 0.0)
            states = interpolate(simulated[list(rows)], t, self._mechanism.step)
            for row, i, q, v in zip(rows, numbers, *states, strict=True):
                found[i] = self._read(cases[i], t, q, v, control[row], batch, row)
        return found

    def _simulate(self, cases: Sequence[Case]) -> tuple[Array, Array, Batch]:
        """States (n, steps + 1, 2, joints) of n cases, their commands, and the batch of models."""
        step = self._mechanism.step
        span = max(float(c.content.cut.t[-1]) for c in cases)
        steps = int(np.ceil(span / step)) + 2
        control = np.array([self._control(c, steps) for c in cases])
        batch = Batch(self._mechanism.model, len(cases), self._jobs)
        for i, case in enumerate(cases):
            case.edit(BatchFields(batch.expand, i))
        if any(batch.expanded(name) is not None for name in CONST):
            batch.set_const()
        states = self._run(batch, cases, control)
        if any(_has_soft_gears(c) for c in cases):
            self._add_soft_gears(cases, control, states)
        return states, control, batch

    def _control(self, case: Case, steps: int) -> Array:
        """Commands (settle + steps, actuators) of a case, the first one held while it settles."""
        found: Array = case.content.commands.at_steps(
            self._mechanism.step, steps, case.readings.command
        )
        return np.concatenate([np.repeat(found[:1], self._settle, axis=0), found])

    def _run(
        self, batch: Batch, cases: Sequence[Case], control: Array, embed: Array | None = None
    ) -> Array:
        """States (n, steps + 1, 2, joints) of the joints, or of those that `embed` numbers."""
        q = np.array([c.start[0] for c in cases])
        v = np.array([c.start[1] for c in cases])
        into = np.arange(q.shape[1]) if embed is None else embed
        batch.bind("qpos")[:, into], batch.bind("qvel")[:, into] = q, v
        with torques().install(self._laws):
            try:
                out = batch.rollout(control.shape[1], control, record=("qpos", "qvel"))
            except SimulationError:
                return np.full(
                    (len(cases), control.shape[1] - self._settle + 1, 2, q.shape[1]), np.inf
                )
        states = np.stack([out["qpos"][..., into], out["qvel"][..., into]], axis=2)
        states = np.concatenate([np.stack([q, v], axis=1)[:, None], states], axis=1)
        states[batch.warning.reshape(len(cases), -1).any(axis=1)] = np.inf
        return states[:, self._settle :]

    def _add_soft_gears(self, cases: Sequence[Case], control: Array, states: Array) -> None:
        """Add to `states` what elasticity or play changes: a split model less its rigid twin."""
        rows = [i for i, c in enumerate(cases) if _has_soft_gears(c)]
        some, u = [cases[i] for i in rows], control[rows]
        if self._variant is None:
            self._variant = Variant(self._mechanism)
        found = []
        for rigid, embed in ((False, self._variant.motor), (True, None)):
            models = [self._variant.model(case, rigid=rigid) for case in some]
            batch = Batch(models[0], len(some), self._jobs)
            batch.set_models(models)
            found.append(self._run(batch, some, u, embed))
        soft, rigid_twin = found
        states[rows] += soft - rigid_twin

    def _read(self, case: Case, t: Array, q: Array, v: Array, control: Array, batch: Batch,
              row: int) -> Array:  # fmt: skip
        """Sensor readings (signals, k) at times t (k,) [s], from states q, v (joints, k) then."""
        readings = case.readings
        rows = np.empty((len(self._signals), len(t)))
        sensors: dict[str, Array] = {}
        if any(s.kind in ("site", "sensor") for s in self._signals):
            sensors = self._read_sensors(batch.get_model(row), q, v)
        for k, signal in enumerate(self._signals):
            if signal.kind == "torque":
                rows[k] = self._torque(signal.joint, batch, row, q, v, control, t)
            elif signal.kind in ("site", "sensor"):
                rows[k] = sensors[signal.name]
            else:
                rows[k] = self._mix[k] @ (q if signal.kind == "position" else v)
            bias, scale = readings.bias.get(signal.name), readings.scale.get(signal.name)
            if scale:
                rows[k] *= 1.0 + scale
            if bias:
                rows[k] += bias
        return rows

    def _torque(self, joint: int, batch: Batch, row: int, q: Array, v: Array, control: Array,
                t: Array) -> Array:  # fmt: skip
        """Motor torque (k,) of a joint from states; MuJoCo records that of an inner stage."""
        actuator = self._mechanism.joints[joint].actuator

        def field(name: str) -> Array:
            own = batch.expanded(name)
            stated: Array = getattr(self._mechanism.model, name)[actuator]
            return stated if own is None else own[row, actuator]

        gain, bias = field("actuator_gainprm"), field("actuator_biasprm")
        low, high = field("actuator_forcerange")
        gear = self._mechanism.model.actuator_gear[actuator, 0]
        step = np.minimum((t / self._mechanism.step).astype(int), len(control) - 1 - self._settle)
        u = control[self._settle + step, actuator]
        force = gain[0] * u + bias[0] + bias[1] * gear * q[joint] + bias[2] * gear * v[joint]
        return np.asarray(np.clip(force, low, high))

    def _read_sensors(self, model: Any, q: Array, v: Array) -> dict[str, Array]:
        """Readings (k,) of sites and sensors at states q, v (joints, k), by name of signal."""
        data, rows = mujoco.MjData(model), []
        for positions, rates in zip(q.T, v.T, strict=True):
            data.qpos[:], data.qvel[:] = positions, rates
            mujoco.mj_forward(model, data)
            rows.append(np.concatenate([data.site_xpos.ravel(), data.sensordata]))
        whole = np.array(rows).T
        return {s.name: whole[s.joint] for s in self._signals if s.kind in ("site", "sensor")}


def _has_soft_gears(case: Case) -> bool:
    gears = (case.readings.elastic, case.readings.gap)
    return any(values is not None and bool(np.any(values)) for values in gears)
