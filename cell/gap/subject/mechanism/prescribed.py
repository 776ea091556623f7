"""Predicts torques by inverse dynamics on the measured motion, to compare with measured ones."""

import copy
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
from numba import types
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, filtfilt, welch

from cell.gap.subject.mechanism.effect import Effect, Readings
from cell.gap.subject.mechanism.effects import registry, torques
from cell.gap.subject.mechanism.engine import Case, Content, Engine
from cell.gap.subject.mechanism.fields import ModelFields
from cell.gap.subject.mechanism.load import MechanismData
from cell.gap.subject.mechanism.loop import Loop, transmissions
from cell.gap.subject.mechanism.model import Mechanism
from cell.gap.subject.mechanism.passive import without_clock
from cell.gap.subject.mechanism.runs import Cut, Recording, Signal, average, phases
from cell.gap.subject.subject import Samples, Words
from drivers.errors import ConfigurationError
from drivers.strip.rod.compiled import entry
from drivers.types import Array, frozen

ORDER = 3  # of the Butterworth filter, run forth and back
CUTOFF = 1.5  # of the frequency that holds most of the rate; Butterworth's passband is flat below
MOST, FLOOR = 0.99, 10.0  # of the rate's power; times the encoder's noise above which power counts
SLOWEST, FASTEST = 5.0, 25.0  # bounds of the cutoff, by the pace of the motion
WIDER = 2.0  # times the cutoff, for motion: mechanics are not linear (3 and 5 do no better)
SETTLED = 10.0  # 1/cutoff from an end or a gap at which its effect on the filter has decayed
GRID = 4000  # places of a run at most at which torques are computed
LIMITED = "moments at the limits of joints and tendons are left out"
DELAYED = "filters and delays of motors are left out: torques are as read"
KEPT = 2048  # inverse dynamics that are cached
NEAR = 0.005  # of a range, within which a joint is at its limit
THINNED, OPEN = 50, 1e-3  # readings in one of which loops are checked; m by which they may gape
Barred = Callable[[Array, Array], NDArray[np.bool_]]
STANDS = 0.05  # of its usual rate, below which a joint may be held by friction
PLAY_SMOOTHING = 0.05  # of a torque's standard deviation, over which a link crosses its play


@dataclass(frozen=True, slots=True)
class Motion:
    """Measured motion and torques of a run on an even time grid `t` (m,) [s], low-pass filtered.

    Positions, rates and accelerations `q`, `v`, `a` (m, joints) and the measured `torques`
    (signals, m) pass one filter, at `WIDER` times the `cutoff` [rad/s] below which torques are
    compared. `known` (signals, m) is false near gaps of the record. `shake` (2, encoders) is the
    standard deviation of v and a that encoder noise makes in the means of samples, and `moves`
    (m or 1, joints, encoders) how joints follow encoders. Along loops `forces` (m, actuators,
    joints) are those of actuators by torque of the open joints.
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
    moves: Array
    forces: Array | None = None

    def below_cutoff(self, rows: Array, t: Array) -> Array:
        """Values (n, k) at times t (k,) [s] of `rows` (n, m) along the grid, below the cutoff."""
        slow = _low_pass(rows, self.t[1] - self.t[0], self.cutoff)
        return np.array([np.interp(t, self.t, row) for row in slow])


def cutoff_of(recordings: Sequence[Recording], joints: Sequence[str], pace: float) -> float:
    """Angular frequency [rad/s] below which motions at `pace` [rad/s] have most of their power.

    It is the median of the `recordings`, in power of rates: what differs between them is noise.
    Beyond it lies the encoders' noise, which in accelerations grows with the cutoff's power of 2.5.
    """
    found = [_cutoff(recording, joints) for recording in recordings]
    return float(np.clip(np.median(found), SLOWEST * pace, FASTEST * pace))


def _cutoff(recording: Recording, joints: Sequence[str]) -> float:
    """Cutoff [rad/s] of one recording: that of its fastest joint."""
    grid = _grid(recording)
    q, _ = _resample(recording, joints, grid)
    w, power = welch(q, 2.0 * np.pi / (grid[1] - grid[0]), nperseg=min(256, len(grid)))
    # no joint moves in the upper quarter of frequencies
    noise = np.median(power[:, len(w) * 3 // 4 :], axis=1, keepdims=True)
    rates = np.cumsum(np.maximum(power - FLOOR * noise, 0.0) * w**2, axis=1)
    return CUTOFF * max(float(w[np.argmax(r >= MOST * r[-1])]) for r in rates)


def _grid(recording: Recording) -> Array:
    """Even times (m,) [s] over a recording, with the median step of its readings."""
    t = recording.t
    return np.arange(0.0, t[-1], max(float(np.median(np.diff(t))), t[-1] / GRID))


def _resample(
    recording: Recording, names: Sequence[str], grid: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Columns (k, m) interpolated at the times `grid` (m,) [s], and the mask (k, m) of gaps."""
    t, columns = recording.t, [recording.columns[name] for name in names]
    present = [np.isfinite(x) for x in columns]
    values = [np.interp(grid, t[p], x[p]) for p, x in zip(present, columns, strict=True)]
    gaps = [np.interp(grid, t, p) < 1.0 for p in present]
    return np.array(values), np.array(gaps, dtype=bool)


def motion_of(recording: Recording, joints: Sequence[str], torques: Sequence[str], cutoff: float,
              width: float, loop: Loop | None, barred: Barred) -> Motion:  # fmt: skip
    """Motion and torques of a recording below `cutoff` [rad/s], for samples of `width` [s].

    `joints` are those that are measured; the others of a `loop` follow them. Readings count as
    gaps where positions (m, joints) and torques (signals, m) are `barred`. Both pass one filter
    without phase (Butterworth, forth and back), and rates are those of the filtered positions: what
    is linear in a mechanism holds as well after as before. What is not holds the better the wider
    the filter; the narrow one follows the mechanics.
    """
    grid = _grid(recording)
    dt = grid[1] - grid[0]
    raw, joint_gaps = _resample(recording, joints, grid)
    measured, torque_gaps = _resample(recording, torques, grid)
    wide = min(WIDER * cutoff, 0.8 * np.pi / dt)
    cutoff = min(cutoff, wide)
    reach = min(round(SETTLED / cutoff / dt), len(grid) // 10)
    filtered = _low_pass(raw, dt, wide)
    every = max(1, int(1.0 / wide / dt))
    closed = filtered.T if loop is None else loop.close(filtered.T)
    shut = np.any(joint_gaps, axis=0) | barred(closed, measured)
    moves, forces = np.eye(len(joints))[None], None
    if loop is not None:
        forces, moves, good = loop.maps(closed[::every])
        shut |= np.repeat(~good, every)[: len(grid)]
    known = np.array([~_near_gaps(row, reach) for row in torque_gaps | shut])
    # white noise of the encoders, of which the filter takes out the part above its cutoff
    noise = (raw - filtered).std(axis=1) / np.sqrt(1.0 - wide * dt / np.pi)
    shake = np.outer(_noise_gain(dt, cutoff, width), noise)
    q, v, a = (frozen(x[::every]) for x in _derivatives(grid, closed))
    slow = frozen(_low_pass(measured, dt, wide)[:, ::every])
    return Motion(recording.name, frozen(grid[::every]), q, v, a, slow, known[:, ::every],
                  cutoff, frozen(shake), moves, forces)  # fmt: skip


def _low_pass(x: Array, dt: float, cutoff: float) -> Array:
    """Rows x (n, m) in steps of `dt` [s], filtered by a low pass at `cutoff` [rad/s]."""
    found: Array = filtfilt(*butter(ORDER, cutoff * dt / np.pi), x, axis=-1)
    return found


def _derivatives(t: Array, x: Array) -> tuple[Array, Array, Array]:
    """Columns x (m, n) over t (m,) [s], and their first and second derivatives (m, n)."""
    spline = make_interp_spline(t, x, k=5)
    return x, spline(t, nu=1), spline(t, nu=2)


def _noise_gain(dt: float, cutoff: float, width: float) -> Array:
    """One-sigma errors (2,) of mean rate and acceleration over `width` [s] by unit white noise."""
    box = np.ones(max(1, round(width / dt)))
    half = len(box) + round(2.0 * SETTLED / cutoff / dt)
    begin = half - len(box) // 2
    mean = np.zeros((1, 2 * half + 1))  # weights of a mean, in the middle of what the filter sees
    mean[0, begin : begin + len(box)] = box / len(box)
    t = dt * np.arange(2.0 * half + 1.0)
    _, rate, acceleration = _derivatives(t, _low_pass(mean, dt, cutoff).T)
    return np.array([np.linalg.norm(rate), np.linalg.norm(acceleration)])


def _near_gaps(gaps: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Mask (m,) of readings within `reach` readings of a gap in `gaps` (m,), or of an end."""
    around = np.pad(gaps.astype(float), reach, constant_values=1.0)
    return np.convolve(around, np.ones(2 * reach + 1), "valid") > 0.5


class Prescribed(Engine):
    """Predicts the torques of actuators along a measured motion, by inverse dynamics."""

    notes: tuple[str, ...] = (
        "torques of the measured motion are compared; the motion itself is not simulated",
    )

    def __init__(self, opened: MechanismData, jobs: int, laws: frozenset[str]) -> None:  # noqa: ARG002
        super().__init__(opened)
        self._known: OrderedDict[bytes, Array] = OrderedDict()
        self._jobs = jobs
        self._model = copy.copy(self._mechanism.model)
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self._model.jnt_actgravcomp[:] = 0  # what motors are relieved of, they do not give
        inputs = opened.file.inputs
        given = [i for i, j in enumerate(self._mechanism.joints) if inputs.get(j.name)]
        model, origin = self._mechanism.model, str(opened.path)
        self._loop = Loop(model, given, origin) if model.neq else None
        led = given if self._loop is None else self._loop.free
        self._joints = [self._mechanism.joints[i].name for i in led]
        self._cutoff = cutoff_of(opened.recordings, self._joints, opened.pace)
        if np.any(model.jnt_limited) or np.any(model.tendon_limited):
            self.notes += (LIMITED,)
        if np.any(model.actuator_delay > 0.0) or np.any(model.actuator_dyntype > 0):
            self.notes += (DELAYED,)
        if self._loop is not None and len(given) == model.nv:
            self.notes += self._notes_on_loop_closure(self._loop)

    def _notes_on_loop_closure(self, loop: Loop) -> tuple[str, ...]:
        """Note for the report where measured joints leave the kinematic loop open; else none."""
        names = [j.name for j in self._mechanism.joints]
        rows = [np.column_stack([r.columns[n] for n in names]) for r in self._opened.recordings]
        known = [q[np.isfinite(q).all(axis=1)][::THINNED] for q in rows]
        gap = max((loop.gap(q) for q in known if len(q)), default=0.0)
        if gap < OPEN:
            return ()
        return (f"the loop does not close by {1e3 * gap:.2g} mm or mrad at the measured joints: an "
                "encoder's zero or the geometry is off; driven joints alone are used",)  # fmt: skip

    def not_honoured(self) -> Iterator[str]:
        """What inverse dynamics would leave out of torques, by name; nothing where it is whole."""
        model = self._mechanism.model
        yield from (f"tendon {model.tendon(i).name}: its frictionloss"
                    for i in np.flatnonzero(model.tendon_frictionloss > 0.0))  # fmt: skip
        if model.npair:
            yield "contact pairs"
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        drives = transmissions(model, data) != 0.0
        for sensor in self._mechanism.torques:
            others = drives[:, self._mechanism.joints[sensor.joint].dof]
            others[sensor.actuator] = False
            if others.any():
                yield f"other motors on joint {self._mechanism.joints[sensor.joint].name}"

    def prepare(self, recording: Recording) -> tuple[Content, Samples]:
        """Content and samples of a run, with the noise that the measured motion adds to torques."""
        content, known = super().prepare(recording)
        error = self._encoder_error(content.motion, content.cut.t)
        _, squares = average(error, content.cut.edges)  # torques come first
        more = np.sqrt(np.concatenate([squares, np.zeros(len(known) - len(squares))]))
        noise, reading = np.hypot(known.noise, more), np.hypot(known.reading, more)
        return content, replace(known, noise=noise, reading=reading)

    def _content(self, recording: Recording, made: Cut, width: float) -> Content:
        """Content of a run with its motion: filtered torques, without those near gaps."""
        names = [s.name for s in self._opened.signals]
        motion = motion_of(recording, self._joints, names, self._cutoff, width, self._loop,
                           self._barred)  # fmt: skip
        filtered = motion.below_cutoff(motion.torques, made.t)
        good = np.all([np.interp(made.t, motion.t, k) == 1.0 for k in motion.known], axis=0)
        if not good.any():
            raise ConfigurationError(
                f"{recording.name}: no reading is left beside gaps, limits of joints and dead "
                "centres; mend angles, zeros or ranges, or leave the run out"
            )
        made = replace(made, values=filtered).keep(good)
        return Content(made, recording.load, motion=motion)

    def _barred(self, q: Array, measured: Array) -> NDArray[np.bool_]:
        """Where (m,) joints and tendons are at limits that inverse dynamics leaves out, or torques.

        `q` (m, joints) are positions, `measured` (signals, m) readings of which torques come first.
        """
        model = self._mechanism.model
        at = np.hstack([q, _tendon_lengths(model, q)])
        low, high = np.vstack([model.jnt_range, model.tendon_range]).T
        edge = np.append(model.jnt_margin, model.tendon_margin) + NEAR * (high - low)
        limited = np.append(model.jnt_limited, model.tendon_limited) > 0
        barred = ((at < low + edge) | (at > high - edge)) @ limited
        for s, row in zip(self._mechanism.torques, measured, strict=False):
            if model.jnt_actfrclimited[s.joint]:
                most = (1.0 - NEAR) * model.jnt_actfrcrange[s.joint]
                barred = barred | (s.gear * row < most[0]) | (s.gear * row > most[1])
        return np.asarray(barred, dtype=bool)

    def _phases(self, content: Content) -> Words:
        """Phase (b,) of each sample, by the speed of the motion in typical rates of the joints."""
        made, motion = content.cut, content.motion
        speed = np.interp(made.t, motion.t, motion.v @ (1.0 / self._mechanism.rate))
        return phases(average(speed[None], made.edges)[0])

    def predict(self, cases: Sequence[Case]) -> list[Array | None]:
        """Torques (signals, k) of each case at its readings."""
        with without_clock(), ThreadPoolExecutor(self._jobs) as pool:
            return list(pool.map(self._torque, cases))

    def _encoder_error(self, motion: Motion, t: Array) -> Array:
        """Standard deviation (torques, k) of predictions at times t (k,) [s] by encoder noise."""
        model, q, v, a = self._model, motion.q, motion.v, motion.a
        plain = _inverse_dynamics(model, q, v, a)
        squares = np.zeros((len(self._mechanism.torques), len(q)))
        for k, (rate, acceleration) in enumerate(motion.shake.T):  # encoder by encoder
            moved = motion.moves[:, :, k]
            for dv, da in ((rate * moved, 0.0), (0.0, acceleration * moved)):
                change = _inverse_dynamics(model, q, v + dv, a + da) - plain
                squares += self._sensor_readings(change, model, motion.forces) ** 2
        return np.array([np.interp(t, motion.t, row) for row in np.sqrt(squares)])

    def _torque(self, case: Case) -> Array:
        """Signals (signals, k) of one case at its readings: torques, and trackings if compared."""
        model = copy.copy(self._model)
        fields = ModelFields(model)
        case.edit(fields)
        fields.finish()
        motion: Motion = case.content.motion
        q, v, a = _true_motion(motion, case.readings, self._mechanism)
        inverse = self._inverse(motion, model, case.readings, q, v, a)
        soft = ((np.multiply, case.readings.elastic), (_play_deflection, case.readings.gap))
        gears = [(bend, values) for bend, values in soft if values is not None and np.any(values)]
        if self._mechanism.trackings:  # measured positions are those of links
            deflection = sum((bend(inverse, values) for bend, values in gears), np.zeros_like(q))
            rows = [self._joint_torques(model, case, q, v, inverse),
                    self._tracking(motion, case, deflection)]  # fmt: skip
            return motion.below_cutoff(np.vstack(rows), case.content.cut.t)
        for bend, values in gears:
            q, v, a = _link_motion(motion, bend(inverse, values), q, v, a)
            inverse = _inverse_dynamics(model, q, v, a)
        needed = self._joint_torques(model, case, q, v, inverse)
        return motion.below_cutoff(needed, case.content.cut.t)

    def _joint_torques(self, model: Any, case: Case, q: Array, v: Array, inverse: Array) -> Array:
        """Readings (torques, m) that balance `inverse` (m, joints) less the torques of effects."""
        motion: Motion = case.content.motion
        forces = motion.forces
        if forces is not None and case.readings.delay:
            columns = forces.reshape(len(forces), -1)
            late = _interpolate_columns(motion.t + case.readings.delay, motion.t, columns)
            forces = late.reshape(forces.shape)
        user = np.array(model.jnt_user)
        dofs = [j.dof for j in self._mechanism.joints]
        user[:, torques().at["dry_friction"]] += model.dof_frictionloss[dofs]
        given = torques().along(q, v, inverse, user)
        for effect, values in case.paths:
            if effect.path is not None:
                given = given + effect.path(self._mechanism, values, motion.t, q, v)
        self._hold(given, model, motion, q, v, inverse, user, forces)
        return self._sensor_readings(inverse - given, model, forces)

    def _hold(self, given: Array, model: Any, motion: Motion, q: Array, v: Array, inverse: Array,
              user: Array, forces: Array | None) -> None:  # fmt: skip
        """Replace the torques `given` (m, joints) by static friction where a joint stands.

        There it balances whatever the motor gives, up to its limit, and no law of the rate says
        how much that is (Karnopp 1985, J. Dyn. Sys. Meas. Control 107).
        """
        for sensor, measured in zip(self._mechanism.torques, motion.torques, strict=False):
            j = sensor.joint
            per_reading = self._torque_per_reading(model, sensor)
            rate, p = v[:, j], user[j]
            standing = np.exp(-((rate / (STANDS * self._mechanism.joints[j].rate)) ** 2))
            for effect in _friction_effects():
                at = torques().at[effect.name]
                if effect.law is None or effect.holds is None or not p[at : at + effect.keys].any():
                    continue
                sliding = effect.law(q[:, j], rate, inverse[:, j], p, at)
                limit = effect.holds(q[:, j], rate, inverse[:, j], p, at)
                borne = inverse[:, j] - given[:, j]
                if forces is not None:  # the loop bears on the joint, too
                    borne = per_reading * self._reading(sensor, inverse - given, model, forces)
                static = np.clip(borne + sliding - per_reading * measured, -limit, limit)
                given[:, j] += standing * (static - sliding)

    def _torque_per_reading(self, model: Any, sensor: Signal) -> float:
        """Torque [N m] of a joint per unit of a `sensor`'s reading, in the edited `model`."""
        number, base = sensor.actuator, self._mechanism.model
        gain = model.actuator_gainprm[number, 0] / base.actuator_gainprm[number, 0]
        return float(sensor.gear * gain)

    def _tracking(self, motion: Motion, case: Case, deflection: Array) -> Array:
        """Measured minus commanded positions (trackings, m), by delay and `deflection` of gears."""
        delay, joints = case.readings.command, [joint for _, joint in self._mechanism.trackings]
        commanded = motion.q + delay * motion.v + 0.5 * delay**2 * motion.a
        behind = _interpolate_columns(motion.t + delay, motion.t, deflection)
        return np.asarray((motion.q - commanded - behind)[:, joints].T)

    def _reading(self, sensor: Signal, needed: Array, model: Any, forces: Array | None) -> Array:
        """Readings (m,) of a torque sensor for the required torques (m, joints)."""
        borne = needed[:, sensor.joint]
        if forces is not None:
            gear = float(model.actuator_gear[sensor.actuator, 0])
            borne = gear * np.einsum("mn,mn->m", forces[:, sensor.actuator], needed)
        return np.asarray(borne / self._torque_per_reading(model, sensor))

    def _sensor_readings(self, needed: Array, model: Any, forces: Array | None) -> Array:
        """Readings (signals, m) of torque sensors for the required torques (m, joints)."""
        return np.array([self._reading(s, needed, model, forces) for s in self._mechanism.torques])

    def _inverse(self, motion: Motion, model: Any, readings: Readings, q: Array, v: Array,
                 a: Array) -> Array:  # fmt: skip
        """Torques (m, joints) of `_inverse_dynamics`, cached by model, motion and readings."""
        key = _cache_key(motion, model, readings)
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = _inverse_dynamics(model, q, v, a)
            while len(self._known) > KEPT:
                self._known.popitem(last=False)
        return found


def _cache_key(motion: Motion, model: Any, readings: Readings) -> bytes:
    """Bytes of all that the inverse dynamics along a motion, read with errors, depends on."""
    fields = [model.body_mass, model.body_inertia, model.body_ipos, model.body_iquat,
              model.dof_armature, model.dof_damping, model.dof_dampingpoly, model.jnt_stiffness,
              model.qpos_spring, model.opt.gravity, np.array(model.opt.density)]  # fmt: skip
    bias, scale = sorted(readings.bias.items()), sorted(readings.scale.items())
    key = b"".join(np.ascontiguousarray(x).tobytes() for x in fields)
    return key + f"{motion.name}{readings.delay}{bias}{scale}".encode()


def _inverse_dynamics(model: Any, q: Array, v: Array, a: Array) -> Array:
    """Torques (m, joints) of rigid bodies, springs, damping and air along a motion (m, joints)."""
    data = mujoco.MjData(model)
    torque = np.empty_like(q)
    _along(model._address, data._address, data.qpos, data.qvel, data.qacc,
            data.qfrc_inverse, q, v, a, torque)  # fmt: skip
    return torque


def _true_motion(motion: Motion, errors: Readings,
                 mechanism: Mechanism) -> tuple[Array, Array, Array]:  # fmt: skip
    """True positions, rates and accelerations (m, joints) of a motion read with `errors`.

    Readings stamped late show an earlier time, so that the motion at t is read at t + delay; in the
    last `delay` seconds, where no reading follows, the last one is held.
    """
    q, v, a = motion.q, motion.v, motion.a
    if errors.delay != 0.0:
        stamps = motion.t + errors.delay
        q, v, a = (_interpolate_columns(stamps, motion.t, columns) for columns in (q, v, a))
    if not errors.bias and not errors.scale:
        return q, v, a
    bias = np.array([errors.bias.get(name, 0.0) for name in mechanism.encoders])
    scale = 1.0 + np.array([errors.scale.get(name, 0.0) for name in mechanism.encoders])
    return (q - bias) / scale, v / scale, a / scale


def _interpolate_columns(at: Array, t: Array, columns: Array) -> Array:
    """Values (k, n) at times `at` (k,) [s] of `columns` (m, n) over `t` (m,) [s], held at ends."""
    return np.array([np.interp(at, t, column) for column in columns.T]).T


def _link_motion(motion: Motion, deflection: Array, q: Array, v: Array,
                 a: Array) -> tuple[Array, Array, Array]:  # fmt: skip
    """Motion (m, joints) of links that stand `deflection` (m, joints) behind motors at q, v, a."""
    behind = (q - deflection) - q  # as floating point has it: not quite -deflection
    smooth = _low_pass(behind.T, motion.t[1] - motion.t[0], motion.cutoff)
    offset, rate, acceleration = _derivatives(motion.t, smooth.T)
    return q + offset, v + rate, a + acceleration


def _play_deflection(torque: Array, gap: Array) -> Array:
    """Angles (m, joints) by which play of width `gap` (joints,) leaves links behind `torque`."""
    crossing = PLAY_SMOOTHING * torque.std(axis=0) + 1e-12  # never zero
    return np.asarray(0.5 * gap * np.tanh(torque / crossing))


def _tendon_lengths(model: Any, q: Array) -> Array:
    """Lengths (m, tendons) of tendons at positions `q` (m, joints); zeros where none is limited."""
    lengths, data = np.zeros((len(q), model.ntendon)), mujoco.MjData(model)
    for row, place in zip(lengths, q, strict=True) if model.tendon_limited.any() else ():
        data.qpos[:] = place
        mujoco.mj_fwdPosition(model, data)
        row[:] = data.ten_length
    return lengths


@cache
def _friction_effects() -> tuple[Effect, ...]:
    """Effects of the library whose torque can hold a standing joint."""
    return tuple(e for e in registry().values() if e.holds is not None)


def _inverse_function() -> Any:
    """MuJoCo's `mj_inverse` as a C function that compiled loops can call."""
    folder = Path(mujoco.__file__).parent
    library = next(p for p in sorted(folder.iterdir()) if p.name.startswith("libmujoco"))
    llvmlite.binding.load_library_permanently(str(library))
    return types.ExternalFunction("mj_inverse", types.void(types.uintp, types.uintp))


_inverse = _inverse_function()


@entry
def _along(  # type: ignore[no-untyped-def]
    model, data, qpos: Array, qvel: Array, qacc: Array, torque: Array, q: Array, v: Array, a: Array,
    out: Array,
) -> None:  # fmt: skip
    """Write inverse dynamics of each row of q, v, a (m, joints) to `out`."""
    for k in range(q.shape[0]):
        qpos[:], qvel[:], qacc[:] = q[k], v[k], a[k]
        _inverse(model, data)
        out[k] = torque
