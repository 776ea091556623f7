"""Inverse dynamics on the measured motion: required torques, compared with measured ones."""

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
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, filtfilt, welch

from cell.gap.subject.mechanism.case import Case, ModelFields
from cell.gap.subject.mechanism.effect import Effect
from cell.gap.subject.mechanism.effects import registry, torques
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.mechanism.passive import without_clock
from cell.gap.subject.mechanism.runs import Recording
from drivers.types import Array, frozen

ORDER = 3  # of the Butterworth filter, run forth and back
CUTOFF = 1.5  # of the frequency that holds most of the rate; Butterworth's passband is flat below
MOST, FLOOR = 0.99, 10.0  # of the rate's power, beyond so many times the encoder's noise
SLOWEST, FASTEST = 5.0, 25.0  # bounds of the cutoff, by the pace of the motion
WIDER = 2.0  # times the cutoff, for motion: mechanics are not linear (3 and 5 do no better)
SETTLED = 10.0  # 1/cutoff from an end or a gap, where the filter has forgotten it
GRID = 4000  # places of a run at most at which torques are computed
KEPT = 2048  # inverse dynamics that are remembered
STANDS = 0.05  # of its usual rate, below which a joint may be held by friction


@dataclass(frozen=True, slots=True)
class Motion:
    """A measured motion on an even grid: `t` (m,) [s]; `q`, `v`, `a` (m, joints) and the measured
    `torques` (signals, m), all low-passed alike at `WIDER` times the `cutoff` [rad/s] below which
    torques are compared. `known` (signals, m) is false near gaps of the record.

    `shake` (2, joints) is one sigma of the errors of v and a that noise of the encoders makes in
    the means of samples.
    """

    name: str
    t: Array
    q: Array
    v: Array
    a: Array
    torques: Array
    known: NDArray[np.bool_]
    cutoff: float
    shake: Array

    def below_cutoff(self, rows: Array, t: Array) -> Array:
        """Signals (n, m) along the motion, below the cutoff, at times t (k,) [s]."""
        slow = _low_pass(rows, self.t[1] - self.t[0], self.cutoff)
        return np.array([np.interp(t, self.t, row) for row in slow])


def cutoff_of(recordings: Sequence[Recording], joints: Sequence[str], pace: float) -> float:
    """Frequency [rad/s] below which motions at `pace` [rad/s] have nearly all of their rates'
    power, of the middle one of the `recordings`: what differs between them is noise.

    What lies beyond is left to the encoders, whose noise in accelerations grows with the cutoff's
    power of 2.5.
    """
    found = [_cutoff(recording, joints) for recording in recordings]
    return float(np.clip(np.median(found), SLOWEST * pace, FASTEST * pace))


def _cutoff(recording: Recording, joints: Sequence[str]) -> float:
    grid = _grid(recording)
    q, _ = _resample(recording, joints, grid)
    w, power = welch(q, 2.0 * np.pi / (grid[1] - grid[0]), nperseg=min(256, len(grid)))
    noise = np.median(power[:, len(w) * 3 // 4 :], axis=1, keepdims=True)
    rates = np.cumsum(np.maximum(power - FLOOR * noise, 0.0) * w**2, axis=1)
    return CUTOFF * max(float(w[np.argmax(r >= MOST * r[-1])]) for r in rates)


def _grid(recording: Recording) -> Array:
    """Even times (m,) [s] of a recording, as dense as its readings are in the middle."""
    t = recording.t
    return np.arange(0.0, t[-1], max(float(np.median(np.diff(t))), t[-1] / GRID))


def _resample(
    recording: Recording, names: Sequence[str], grid: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Columns (k, m) at the times `grid` (m,), and where they are absent."""
    t, columns = recording.t, [recording.columns[name] for name in names]
    some = [np.isfinite(x) for x in columns]
    values = [np.interp(grid, t[s], x[s]) for s, x in zip(some, columns, strict=True)]
    return np.array(values), np.array([np.interp(grid, t, s) < 1.0 for s in some], dtype=bool)


def motion_of(recording: Recording, joints: Sequence[str], torques: Sequence[str],
              cutoff: float, width: float) -> Motion:  # fmt: skip
    """The motion of a recording below `cutoff` [rad/s], to be compared in samples of `width` [s].

    Positions and torques pass one filter without phase (Butterworth, forth and back), and rates are
    those of the filtered positions: what is linear in a mechanism holds as well after as before.
    What is not holds the better the wider the filter; the narrow one follows the mechanics.
    """
    grid = _grid(recording)
    dt = grid[1] - grid[0]
    raw, lost = _resample(recording, joints, grid)
    measured, absent = _resample(recording, torques, grid)
    wide = min(WIDER * cutoff, 0.8 * np.pi / dt)
    cutoff = min(cutoff, wide)
    reach = min(round(SETTLED / cutoff / dt), len(grid) // 10)
    gaps = absent | np.any(lost, axis=0, keepdims=True)
    known = np.array([~_near_gaps(row, reach) for row in gaps])
    filtered = _low_pass(raw, dt, wide)
    white = (raw - filtered).std(axis=1) / np.sqrt(1.0 - wide * dt / np.pi)
    shake = np.outer(_noise_gain(dt, cutoff, width), white)
    every = max(1, int(1.0 / wide / dt))
    q, v, a = (frozen(x[::every]) for x in _derivatives(grid, filtered.T))
    slow = frozen(_low_pass(measured, dt, wide)[:, ::every])
    return Motion(recording.name, frozen(grid[::every]), q, v, a, slow, known[:, ::every],
                  cutoff, frozen(shake))  # fmt: skip


def _low_pass(x: Array, dt: float, cutoff: float) -> Array:
    """Rows of x (n, m) filtered by a low pass at `cutoff` [rad/s]."""
    found: Array = filtfilt(*butter(ORDER, cutoff * dt / np.pi), x, axis=-1)
    return found


def _derivatives(t: Array, x: Array) -> tuple[Array, Array, Array]:
    """Columns x (m, n) over t (m,), and their first and second derivatives."""
    spline = make_interp_spline(t, x, k=5)
    return x, spline(t, nu=1), spline(t, nu=2)


def _noise_gain(dt: float, cutoff: float, width: float) -> Array:
    """Errors (2,) of mean rates and accelerations of filtered positions, of a unit of white noise
    in each; means are over `width` [s].
    """
    box = np.ones(max(1, round(width / dt)))
    half = len(box) + round(2.0 * SETTLED / cutoff / dt)
    one = np.zeros((1, 2 * half + 1))
    one[0, half - len(box) // 2 : half - len(box) // 2 + len(box)] = box / len(box)
    made = _derivatives(dt * np.arange(2.0 * half + 1.0), _low_pass(one, dt, cutoff).T)
    return np.array([np.linalg.norm(x) for x in made[1:]])


def _near_gaps(gaps: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Mask of readings nearer than `reach` to a gap, or to an end."""
    around = np.pad(gaps.astype(float), reach, constant_values=1.0)
    return np.convolve(around, np.ones(2 * reach + 1), "valid") > 0.5


class Prescribed:
    """Predicts the torques of actuators along the measured motion."""

    def __init__(self, mechanism: Mechanism, jobs: int) -> None:
        self._mechanism = mechanism
        self._known: OrderedDict[bytes, Array] = OrderedDict()
        self._jobs = jobs
        self._model = copy.copy(mechanism.model)
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)

    def predict(self, cases: Sequence[Case]) -> list[Array | None]:
        """Torques (signals, k) of each case at its readings."""
        with without_clock(), ThreadPoolExecutor(self._jobs) as pool:
            return list(pool.map(self._torque, cases))

    def encoder_error(self, motion: Motion, t: Array) -> Array:
        """Errors (torques, k) of predictions at times t (k,) by encoder noise."""
        model, (q, v, a) = self._model, (motion.q, motion.v, motion.a)
        plain = self._inverse(motion, model, q, v, a, None)
        squares = np.zeros_like(plain)
        for error in np.diag(motion.shake[0]):
            squares += (self._inverse(motion, model, q, v + error, a, None) - plain) ** 2
        for error in np.diag(motion.shake[1]):
            squares += (self._inverse(motion, model, q, v, a + error, None) - plain) ** 2
        rows = self._sensor_readings(np.sqrt(squares), model)
        return np.abs([np.interp(t, motion.t, row) for row in rows])

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
            turns = sum(
                (_gear_deflection(inverse, v, kind) for kind, v in turned), np.zeros_like(q)
            )
            rows = [self._joint_torques(model, case, q, v, inverse),
                    self._tracking(motion, case, turns)]  # fmt: skip
            return motion.below_cutoff(np.vstack(rows), case.content.cut.t)
        for kind, values in turned:
            q, v, a = _link_motion(motion, inverse, (q, v, a), values, kind)
            inverse = self._inverse(motion, model, q, v, a, None)
        needed = self._joint_torques(model, case, q, v, inverse)
        return motion.below_cutoff(needed, case.content.cut.t)

    def _joint_torques(self, model: Any, case: Case, q: Array, v: Array, inverse: Array) -> Array:
        motion: Motion = case.content.motion
        user = np.array(model.jnt_user)
        given = torques().along(q, v, inverse, user)
        for effect, values in case.paths:
            if effect.path is not None:
                given = given + effect.path(self._mechanism, values, q, v)
        self._hold(given, model, motion, q, v, inverse, user)
        return self._sensor_readings(inverse - given, model)

    def _hold(self, given: Array, model: Any, motion: Motion, q: Array, v: Array, inverse: Array,
              user: Array) -> None:  # fmt: skip
        """Replace the torques `given` (m, joints) by static friction where a joint stands.

        There it balances whatever the motor gives, up to its limit, and no law of the rate says
        how much that is (Karnopp 1985, J. Dyn. Sys. Meas. Control 107).
        """
        for (_, j), row in zip(self._mechanism.torques, motion.torques, strict=False):
            p, along = user[j], (q[:, j], v[:, j], inverse[:, j])
            stands = np.exp(-((along[1] / (STANDS * self._mechanism.joints[j].rate)) ** 2))
            for effect in _friction_effects():
                at = torques().at[effect.name]
                if effect.law is None or effect.holds is None or not p[at : at + effect.keys].any():
                    continue
                slides, most = (f(*along, p, at) for f in (effect.law, effect.holds))
                others = inverse[:, j] - given[:, j] + slides
                held = np.clip(others - self._torque_per_reading(model, j) * row, -most, most)
                given[:, j] += stands * (held - slides)

    def _torque_per_reading(self, model: Any, joint: int) -> float:
        """Torque of a joint [N m] per reading of its motor's sensor."""
        number, base = self._mechanism.joints[joint].actuator, self._mechanism.model
        gain = model.actuator_gainprm[number, 0] / base.actuator_gainprm[number, 0]
        return float(model.actuator_gear[number, 0] * gain)

    def _tracking(self, motion: Motion, case: Case, turns: Array) -> Array:
        """Measured minus commanded positions of joints whose links stand `turns` (m, joints) behind
        their motors; commands take effect late.
        """
        ahead, rows = case.readings.command, []
        soon = motion.q + ahead * motion.v + 0.5 * ahead**2 * motion.a  # as motors stood already
        for _, joint in self._mechanism.trackings:
            behind = np.interp(motion.t + ahead, motion.t, turns[:, joint])
            rows.append(motion.q[:, joint] - soon[:, joint] - behind)
        return np.array(rows)

    def _sensor_readings(self, needed: Array, model: Any) -> Array:
        """Readings (signals, m) of torque sensors for the required torques (m, joints)."""
        return np.array(
            [needed[:, j] / self._torque_per_reading(model, j) for _, j in self._mechanism.torques]
        )

    def _inverse(self, motion: Motion, model: Any, q: Array, v: Array, a: Array,
                 case: Case | None) -> Array:  # fmt: skip
        """Torques (m, joints) of rigid bodies, springs, damping and air; cached."""
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
    """The true motion, from readings with the errors of their encoders."""
    r, (q, v, a) = case.readings, (motion.q, motion.v, motion.a)
    if r.delay != 0.0:
        late = motion.t + r.delay
        q, v, a = (np.array([np.interp(late, motion.t, x) for x in y.T]).T for y in (q, v, a))
    if not r.bias and not r.scale:
        return q, v, a
    bias = np.array([r.bias.get(n, 0.0) for n in mechanism.encoders])
    scale = 1.0 + np.array([r.scale.get(n, 0.0) for n in mechanism.encoders])
    return (q - bias) / scale, v / scale, a / scale


def _link_motion(
    motion: Motion, torque: Array, moved: tuple[Array, Array, Array], values: Array, kind: str
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Motion of the links behind gears with elasticity or play, under `torque` (m, joints)."""
    q, v, a = moved
    links = q - _gear_deflection(torque, values, kind)
    smooth = _low_pass((links - q).T, motion.t[1] - motion.t[0], motion.cutoff)
    bent, turn, jerk = _derivatives(motion.t, smooth.T)
    return q + bent, v + turn, a + jerk


def _gear_deflection(torque: Array, values: Array, kind: str) -> Array:
    """Angles (m, joints) by which links stand behind their motors under `torque` (m, joints)."""
    if kind == "elastic":
        return np.asarray(values * torque)
    return np.asarray(0.5 * values * np.tanh(torque / (0.05 * torque.std(axis=0) + 1e-12)))


@cache
def _friction_effects() -> tuple[Effect, ...]:
    """Effects whose torque holds a standing joint."""
    return tuple(e for e in registry().values() if e.holds is not None)


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
