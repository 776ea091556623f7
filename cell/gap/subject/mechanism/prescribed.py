"""Inverse dynamics on the measured motion: the torques that it takes, beside those measured."""

import copy
import ctypes
from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numba
import numpy as np
from scipy.signal import savgol_filter

from cell.gap.subject.mechanism.case import Case, ModelFields
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.mechanism.passive import Torques
from cell.gap.subject.mechanism.runs import Recording
from drivers.types import Array, frozen

ORDER = 3  # of the local polynomials that smooth and differentiate
GRID = 4000  # places of a run at most at which torques are computed
PER_WIDTH = 6  # places of the motion that are kept within a filter's width
KEPT = 2048  # inverse dynamics that are remembered


@dataclass(frozen=True, slots=True)
class Motion:
    """A measured motion on an even grid: `t` (m,) [s]; `q`, `v`, `a` (m, joints) and the measured
    `torques` (signals, m), all smoothed alike.
    """

    name: str
    t: Array
    q: Array
    v: Array
    a: Array
    torques: Array


def motion_of(recording: Recording, joints: Sequence[str], torques: Sequence[str],
              pace: float) -> Motion:  # fmt: skip
    """The motion of a recording, smoothed by local cubics over a quarter of a radian at `pace`
    [rad/s] (Savitzky and Golay 1964).
    """
    t = recording.t
    dt = max(float(np.median(np.diff(t))), t[-1] / GRID)
    grid = np.arange(0.0, t[-1], dt)
    width = max(5, 2 * round(0.25 / pace / dt) + 1)
    width = min(width, (len(grid) - 1) // 2 * 2 - 1)

    def even(name: str) -> Array:
        x = recording.columns[name]
        some = np.isfinite(x)
        found = np.interp(grid, t[some], x[some])
        gaps = np.interp(grid, t, some.astype(float)) < 1.0
        return np.where(gaps, np.nan, found) if name in torques else found

    q = np.array([even(name) for name in joints]).T
    every = max(1, width // PER_WIDTH)
    parts = [savgol_filter(q, width, ORDER, deriv=k, delta=dt, axis=0)[::every] for k in range(3)]
    smooth = np.array([_smooth(even(name), width)[::every] for name in torques])
    at, speed, acceleration = map(frozen, parts)
    return Motion(recording.name, frozen(grid[::every]), at, speed, acceleration, frozen(smooth))


def _smooth(x: Array, width: int) -> Array:
    """A column filtered as the motion is; absent where a reading within the filter is."""
    some = np.isfinite(x)
    found = savgol_filter(np.where(some, x, 0.0), width, ORDER)
    return np.where(np.convolve(~some, np.ones(width), "same") > 0.5, np.nan, found)


class Prescribed:
    """Predicts the torques of actuators along measured motion."""

    def __init__(self, mechanism: Mechanism, torques: Torques, jobs: int) -> None:
        self._mechanism, self._torques = mechanism, torques
        self._known: OrderedDict[bytes, Array] = OrderedDict()
        self._jobs = jobs
        self._model = copy.copy(mechanism.model)
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)

    def predict(self, cases: Sequence[Case]) -> list[Array | None]:
        """Torques (signals, k) of each case at its readings."""
        with ThreadPoolExecutor(self._jobs) as pool:
            return list(pool.map(self._torque, cases))

    def _torque(self, case: Case) -> Array:
        model = copy.copy(self._model)
        fields = ModelFields(model)
        case.edit(fields)
        fields.finish()
        motion: Motion = case.content.motion
        q, v, a = _undo_encoders(motion, case, self._mechanism)
        inverse = self._inverse(motion, model, q, v, a, case)
        gears = (("elastic", case.readings.elastic), ("gap", case.readings.gap))
        turned = [(kind, values) for kind, values in gears if values is not None and np.any(values)]
        if self._mechanism.trackings:
            turns = sum((_turn(inverse, v, kind) for kind, v in turned), np.zeros_like(q))
            return np.vstack([self._joint_torques(model, case, q, v, inverse),
                              self._tracking(motion, case, turns)])  # fmt: skip
        for kind, values in turned:
            q, v, a = _behind(motion, inverse, (q, v, a), values, kind)
            inverse = self._inverse(motion, model, q, v, a, None)
        return self._joint_torques(model, case, q, v, inverse)

    def _joint_torques(self, model: Any, case: Case, q: Array, v: Array, inverse: Array) -> Array:
        user = np.array(model.jnt_user)
        needed = inverse - self._torques.along(q, v, inverse, user)
        for effect, values in case.paths:
            if effect.path is not None:
                needed = needed - effect.path(self._mechanism, values, q, v)
        return self._sensor_readings(needed, model, case)

    def _tracking(self, motion: Motion, case: Case, turns: Array) -> Array:
        """Measured minus commanded positions of joints whose links stand `turns` (m, joints) behind
        their motors, which follow commands late.
        """
        ahead, rows = case.readings.command, []
        soon = motion.q + ahead * motion.v + 0.5 * ahead**2 * motion.a  # as motors stood already
        for _, joint in self._mechanism.trackings:
            behind = np.interp(motion.t + ahead, motion.t, turns[:, joint])
            row = motion.q[:, joint] - soon[:, joint] - behind
            rows.append(np.interp(case.content.cut.t, motion.t, row))
        return np.array(rows)

    def _sensor_readings(self, needed: Array, model: Any, case: Case) -> Array:
        """What the sensors of torque read of the torques (m, joints) that are needed."""
        rows = []
        base = self._mechanism.model
        for _, joint in self._mechanism.torques:
            number = self._mechanism.joints[joint].actuator
            gain = model.actuator_gainprm[number, 0] / base.actuator_gainprm[number, 0]
            gear = model.actuator_gear[number, 0]
            rows.append(needed[:, joint] / (gear * gain))
        t = case.content.cut.t
        return np.array([np.interp(t, case.content.motion.t, row) for row in rows])

    def _inverse(self, motion: Motion, model: Any, q: Array, v: Array, a: Array,
                 case: Case | None) -> Array:  # fmt: skip
        """Torques (m, joints) of rigid bodies, springs, damping and air; remembered."""
        key = None
        if case is not None:
            seen = [model.body_mass, model.body_inertia, model.body_ipos, model.body_iquat,
                    model.dof_armature, model.dof_damping, model.dof_dampingpoly,
                    model.jnt_stiffness, model.qpos_spring, model.opt.gravity,
                    np.array(model.opt.density)]  # fmt: skip
            r = case.readings
            key = b"".join(np.ascontiguousarray(x).tobytes() for x in seen)
            key += (
                f"{motion.name}{r.delay}{sorted(r.bias.items())}{sorted(r.scale.items())}".encode()
            )
            found = self._known.get(key)
            if found is not None:
                return found
        data = mujoco.MjData(model)
        out = np.empty_like(q)
        _loop()(model._address, data._address, data.qpos, data.qvel, data.qacc,
               data.qfrc_inverse, q, v, a, out)  # fmt: skip
        if key is not None:
            self._known[key] = out
            while len(self._known) > KEPT:
                self._known.popitem(last=False)
        return out


def _undo_encoders(motion: Motion, case: Case, mechanism: Mechanism) -> tuple[Array, Array, Array]:
    """The true motion behind what encoders read."""
    r, (q, v, a) = case.readings, (motion.q, motion.v, motion.a)
    if r.delay != 0.0:
        late = motion.t + r.delay
        q, v, a = (np.array([np.interp(late, motion.t, x) for x in y.T]).T for y in (q, v, a))
    if not r.bias and not r.scale:
        return q, v, a
    bias = np.array([r.bias.get(n, 0.0) for n in mechanism.encoders])
    scale = 1.0 + np.array([r.scale.get(n, 0.0) for n in mechanism.encoders])
    return (q - bias) / scale, v / scale, a / scale


def _behind(
    motion: Motion, torque: Array, moved: tuple[Array, Array, Array], values: Array, kind: str
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Motion of the links behind gears that twist or have play, under `torque` (m, joints)."""
    q, v, a = moved
    links = q - _turn(torque, values, kind)
    dt, width = motion.t[1] - motion.t[0], 2 * PER_WIDTH + 1
    bent, turn, jerk = (savgol_filter(links - q, width, ORDER, deriv=k, delta=dt, axis=0)
                        for k in range(3))  # fmt: skip
    return q + bent, v + turn, a + jerk


def _turn(torque: Array, values: Array, kind: str) -> Array:
    """By how much links stand behind their motors (m, joints) under `torque` (m, joints)."""
    if kind == "elastic":
        return np.asarray(values * torque)
    return np.asarray(0.5 * values * np.tanh(torque / (0.05 * torque.std(axis=0) + 1e-12)))


@cache
def _inverse_function() -> Any:
    """`mj_inverse` by its address, for compiled loops."""
    folder = Path(mujoco.__file__).parent
    library = next(p for p in sorted(folder.iterdir()) if p.name.startswith("libmujoco"))
    function = ctypes.CDLL(str(library)).mj_inverse
    function.argtypes, function.restype = (ctypes.c_size_t, ctypes.c_size_t), None
    return function


@cache
def _loop() -> Any:
    inverse = _inverse_function()

    @numba.njit(nogil=True)
    def along(model, data, qpos, qvel, qacc, torque, q, v, a, out):  # type: ignore[no-untyped-def]
        for k in range(q.shape[0]):
            qpos[:], qvel[:], qacc[:] = q[k], v[k], a[k]
            inverse(model, data)
            out[k] = torque

    return along
