"""Predicts torques by inverse dynamics on the measured motion, to compare with measured
ones.
"""

import copy
from collections.abc import Hashable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
from numba import types
from numpy.typing import NDArray

from cell.gap.subject.mechanism.closed_loops import ClosedLoops, transmissions
from cell.gap.subject.mechanism.contradictions import (
    FOLLOWS,
    JointTorques,
    judge_torques,
    matches,
)
from cell.gap.subject.mechanism.effects import torques
from cell.gap.subject.mechanism.effects.friction import DRY_FRICTION, dry_law, dry_limit
from cell.gap.subject.mechanism.model import Mechanism, poses
from cell.gap.subject.mechanism.motion import (
    FilteredMotion,
    cutoff_of,
    link_motion,
    motion_of,
    true_motion,
)
from cell.gap.subject.mechanism.recordings import Cut, Recording, Signal, average
from cell.gap.subject.mechanism.subject import Case, Content, MechanismSubject
from cell.gap.subject.subject import Finding, FitRun
from drivers.base.errors import ConfigurationError
from drivers.base.geometry import interpolate_columns
from drivers.base.jit import entry
from drivers.base.types import Array

KEPT = 2048  # inverse dynamics that are cached
NEAR = 0.005  # of a range, within which a joint is at its limit
CHECK_EVERY = 50  # readings in one of which the closure of loops is checked
LOOP_TOLERANCE = 1e-3  # m or rad by which measured joints may leave a loop open
STANDS = 0.05  # of its usual rate, below which a joint may be held by friction
# of a torque's standard deviation, over which a link crosses its play
PLAY_SMOOTHING = 0.05


class InverseDynamics(MechanismSubject):
    """Measured runs of a mechanism, of which the actuators' torques are predicted by
    inverse dynamics along the measured motion.
    """

    notes: Sequence[str] = (
        "torques of the measured motion are compared; the motion itself is not"
        " simulated",
    )

    def __init__(
        self, mechanism: Mechanism, jobs: int = 1, without: Sequence[str] = ()
    ) -> None:
        super().__init__(mechanism, jobs, without)
        self._known: dict[Hashable, Array] = {}
        model = mechanism.model
        origin = str(mechanism.path)
        self._model = copy.copy(model)
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        # what motors are relieved of, they do not give
        self._model.jnt_actgravcomp[:] = 0
        inputs = mechanism.file.inputs
        joints = mechanism.joints
        given = [
            i for i, joint in enumerate(joints) if inputs.get(joint.name) == "position"
        ]
        compared = [s.joint for s in mechanism.compared("torque")]
        loop = None
        if model.neq:
            loop = ClosedLoops(model, given, compared=compared, origin=origin)
        self._loop = loop
        if not loop and len(given) < model.njnt:
            missing = next(
                joint.name for i, joint in enumerate(joints) if i not in given
            )
            raise ConfigurationError(
                f"{origin}: inputs.{missing}: is missing; in mode prescribed every"
                " joint's motion is given: add it as position"
            )

        independent = loop.independent if loop else given
        self._joints = [joints[i].name for i in independent]
        recordings = [*map(self._with_standing, mechanism.recordings)]
        self._cutoff = cutoff_of(recordings, self._joints, mechanism.pace)
        self.notes = (*self.notes, *self._notes_on_model(given))
        self.runs = tuple(map(self._run, recordings))

    def _with_standing(self, recording: Recording) -> Recording:
        """Copy of a recording with a constant column for each joint that stands still
        at its stated position.
        """
        model = self._model
        standing = self._loop.stand if self._loop else ()
        columns = {
            model.joint(j).name: np.full(len(recording.t), model.qpos0[j])
            for j in standing
        }
        return replace(recording, columns={**recording.columns, **columns})

    def _notes_on_model(self, given: Sequence[int]) -> Iterator[str]:
        """Yield notes on the torques that inverse dynamics leaves out, and on kinematic
        loops that the measured motion leaves open.
        """
        mechanism = self.mechanism
        loop = self._loop
        model = mechanism.model
        if np.any(model.jnt_limited) or np.any(model.tendon_limited):
            yield "moments at the limits of joints and tendons are left out"
        if np.any(model.actuator_delay > 0.0) or np.any(model.actuator_dyntype > 0):
            yield "filters and delays of motors are left out: torques are as read"
        if not loop:
            return

        for joint in loop.stand:
            yield f"joint {model.joint(joint).name} has no column: it stands still"

        names = [j.name for j in mechanism.joints]
        whole = mechanism.recordings if len(given) == model.nv else ()
        known = [r.poses(names)[::CHECK_EVERY] for r in whole]
        gap = max((loop.gap(q) for q in known if len(q)), default=0.0)
        if gap >= LOOP_TOLERANCE:
            yield (
                f"the loop does not close by {1e3 * gap:.2g} mm or mrad at the measured"
                " joints: an encoder's zero or the geometry is off; driven joints"
                " alone are used"
            )

    def not_honoured(self) -> Iterator[str]:
        """Names of the parts of the model whose torques inverse dynamics
        would ignore.
        """
        model = self.mechanism.model
        yield from (
            f"tendon {model.tendon(i).name}: its frictionloss"
            for i in np.flatnonzero(model.tendon_frictionloss > 0.0)
        )
        if model.npair:
            yield "contact pairs"

        (data,) = poses(model, [model.qpos0], mujoco.mj_forward)
        drives = transmissions(model, data) != 0.0
        for sensor in self._sensors:
            others = drives[:, sensor.joint]
            others[sensor.actuator] = False
            if others.any():
                yield (
                    f"other motors on joint {self.mechanism.joints[sensor.joint].name}"
                )

    def _run(self, recording: Recording) -> FitRun:
        """Run for a fit, in whose noise is also what the noise of the measured motion
        adds to the predicted torques.
        """
        run = super()._run(recording)
        content = run.content
        known = run.samples
        error = self._encoder_error(content.motion, content.cut.t)
        _, squares = average(error, content.cut.edges)  # torques come first
        more = np.sqrt(np.concatenate([squares, np.zeros(len(known) - len(squares))]))
        noise = np.hypot(known.noise, more)
        reading = np.hypot(known.reading, more)
        return replace(run, samples=replace(known, noise=noise, reading=reading))

    def _content(self, recording: Recording, cut: Cut) -> Content:
        """Readings `cut` from a run, with all signals low-pass filtered below the
        cutoff, and without readings near gaps of the record.
        """
        names = [signal.name for signal in self.mechanism.signals]
        motion = motion_of(
            recording,
            self._joints,
            torques=names,
            cutoff=self._cutoff,
            width=cut.width,
            loops=self._loop,
            barred=self._barred,
        )
        t = cut.t
        filtered = motion.below_cutoff(motion.torques, t)
        good = np.interp(t, motion.t, motion.known) == 1.0
        if not good.any():
            raise ConfigurationError(
                f"{recording.name}: no reading is left beside gaps, limits of joints"
                " and dead centres; mend angles, zeros or ranges, or leave the run out"
            )

        cut = cut._replace(values=filtered).keep(good)
        speed = np.interp(cut.t, motion.t, motion.v @ (1.0 / self.mechanism.rate))
        return Content(cut, speed, recording.load, motion=motion)

    def _barred(self, q: Array, measured: Array) -> NDArray[np.bool_]:
        """Mask, one value for each time, of the moments at which a joint or tendon
        stands at its limit, or a motor gives its largest torque.

        `q` (m, joints) are positions, `measured` (signals, m) readings of which torques
        come first.
        """
        model = self.mechanism.model
        at = np.hstack(
            [q, [d.ten_length.copy() for d in poses(model, q, mujoco.mj_fwdPosition)]]
        )
        low, high = np.vstack([model.jnt_range, model.tendon_range]).T
        edge = np.append(model.jnt_margin, model.tendon_margin) + NEAR * (high - low)
        joint_limited = model.jnt_limited > 0
        if self._loop:  # others bear no part of a compared torque
            joint_limited = joint_limited & ~self._loop.apart

        limited = np.append(joint_limited, model.tendon_limited > 0)
        barred = ((at < low + edge) | (at > high - edge)) @ limited
        for sensor, row in zip(self._sensors, measured, strict=False):
            if model.jnt_actfrclimited[sensor.joint]:
                low, high = (1.0 - NEAR) * model.jnt_actfrcrange[sensor.joint]
                torque = sensor.gear * row
                barred = barred | (torque < low) | (torque > high)

        return np.asarray(barred, dtype=bool)

    def predict(self, cases: Sequence[Case]) -> list[Array]:
        """Predicted signals of each of `cases`, as an array of shape (signals,
        readings).
        """
        with ThreadPoolExecutor(self._jobs) as pool:
            found = list(pool.map(self._signals, cases))
        known = self._known
        while len(known) > KEPT:  # while no thread adds to them
            known.pop(next(iter(known)))
        return found

    def _encoder_error(self, motion: FilteredMotion, t: Array) -> Array:
        """Standard deviation of the predicted torques that the noise of the encoders
        causes, a row for each torque and a column for each time in `t` [s].
        """
        model = self._model
        q = motion.q
        v = motion.v
        a = motion.a
        plain = _inverse_dynamics(model, q, v, a)

        squares = np.zeros((len(self._sensors), len(q)))
        for k, (rate, acceleration) in enumerate(motion.shake.T):  # encoder by encoder
            moved = motion.moves[:, :, k]
            for dv, da in ((rate * moved, 0.0), (0.0, acceleration * moved)):
                change = _inverse_dynamics(model, q, v + dv, a + da) - plain
                squares += self._readings(model, motion.forces, change) ** 2

        return interpolate_columns(t, motion.t, np.sqrt(squares).T).T

    def contradictions(self) -> Iterator[Finding]:
        """Findings on the recordings, and on measured torques in another unit, of
        another sign or at another time than the model's.
        """
        yield from super().contradictions()
        yield from self.judge()

    def judge(self) -> Iterator[Finding]:
        """Findings on measured torques in another unit, of another sign or at another
        time than the model's.
        """
        yield from judge_torques(self.mechanism, self._torques_by_run())

    def torque_factors(self) -> dict[str, float]:
        """How many times the model's the measured torques are, by signal, in the median
        of the runs, where they follow it.
        """
        return {
            signal.name: float(np.median(factors))
            for signal, found in matches(self.mechanism, self._torques_by_run())
            if (factors := [m.factor for m in found.values() if m.follows > FOLLOWS])
        }

    def _torques_by_run(self) -> dict[str, list[JointTorques]]:
        return {run.name: self._compared_torques(run) for run in self.runs}

    def _compared_torques(self, run: FitRun) -> list[JointTorques]:
        """Torques of each signal along the motion of `run`, both as measured and as the
        model predicts them as it is stated.
        """
        motion = run.content.motion
        case = self._case(self.stated(run))
        known = motion.known
        t = motion.t
        measured, stated = (
            motion.below_cutoff(torques, t)[:, known]
            for torques in (motion.torques, self._along(case))
        )
        q, v, a = (x[known].T for x in (motion.q, motion.v, motion.a))
        rows = zip(
            [sensor.joint for sensor in self._sensors], measured, stated, strict=False
        )
        return [
            JointTorques(
                t=t[known],
                measured=read,
                model=model,
                q=q[j],
                v=v[j],
                a=a[j],
                cutoff=motion.cutoff,
            )
            for j, read, model in rows
        ]

    def _signals(self, case: Case) -> Array:
        """Predicted signals at the readings of a run, a row for each signal and a
        column for each reading.
        """
        motion: FilteredMotion = case.content.motion
        return motion.below_cutoff(self._along(case), case.content.cut.t)

    def _along(self, case: Case) -> Array:
        """Predicted signals at all times of the measured motion, a row for each signal:
        torques, then positions minus commands where these are compared.
        """
        model = case.edited(self._model)
        readings = case.readings
        key = case.motion
        motion: FilteredMotion = case.content.motion
        q, v, a = true_motion(motion, readings)
        inverse = self._known.get(key)
        if inverse is None:
            inverse = self._known[key] = _inverse_dynamics(model, q, v, a)

        soft = ((np.multiply, readings.elastic), (_play_deflection, readings.gap))
        gears = [(bend, values) for bend, values in soft if np.any(values)]
        if self.mechanism.compared("tracking"):  # measured positions are those of links
            bends = (bend(inverse, values) for bend, values in gears)
            bent = sum(bends, np.zeros_like(q))
            torque = self._torques(model, case, q, v, inverse)
            return np.vstack([torque, self._tracking(motion, case, bent)])

        load = self._loads(motion, model, inverse) if gears else inverse
        for bend, values in gears:
            q, v, a = link_motion(motion, deflection=bend(load, values), q=q, v=v, a=a)
            inverse = _inverse_dynamics(model, q, v, a)

        return self._torques(model, case, q, v, inverse)

    def _loads(self, motion: FilteredMotion, model: Any, inverse: Array) -> Array:
        """Torques that the joints' gears bear, a row for each time: measured ones where
        there are any, and those of `inverse` dynamics elsewhere.

        Those of the motors' own motion differ from them where links resonate on their
        gears.
        """
        loads = inverse.copy()
        for sensor, reading in zip(self._sensors, motion.torques, strict=False):
            loads[:, sensor.joint] = self._torque_per_reading(model, sensor) * reading
        return loads

    def _torques(
        self, model: Any, case: Case, q: Array, v: Array, inverse: Array
    ) -> Array:
        """Predicted torque readings, a row for each sensor: the torques of `inverse`
        dynamics without those that effects such as friction add.
        """
        motion: FilteredMotion = case.content.motion
        t = motion.t
        forces = motion.forces
        delay = case.readings.delay
        if forces is not None and delay:  # readings are stamped late
            late = interpolate_columns(t + delay, t, forces.reshape(len(t), -1))
            forces = late.reshape(forces.shape)

        user = np.array(model.jnt_user)
        user[:, torques().at[DRY_FRICTION.name]] += model.dof_frictionloss
        applied = torques().along(q, v, inverse, user)

        for effect, values in case.known:
            if effect.path:
                applied = applied + effect.path(self.mechanism, values, t, q, v)

        self._stick(
            applied,
            model,
            forces,
            measured=motion.torques,
            q=q,
            v=v,
            inverse=inverse,
            user=user,
        )
        return self._readings(model, forces, inverse - applied)

    def _stick(
        self,
        applied: Array,
        model: Any,
        forces: Array | None,
        measured: Array,
        q: Array,
        v: Array,
        inverse: Array,
        user: Array,
    ) -> None:
        """Change the torques `applied`, a row for each time and a column for each
        joint, so that static friction holds a joint that stands.

        There it balances whatever the motor gives, by its readings `measured` (signals,
        m), up to a limit, and no law of the rate says how much that is (Karnopp 1985,
        J. Dyn. Sys. Meas. Control 107).
        """
        at = torques().at[DRY_FRICTION.name]
        for sensor, reading in zip(self._sensors, measured, strict=False):
            j = sensor.joint
            rate = v[:, j]
            p = user[j]
            standing = np.exp(-((rate / (STANDS * self.mechanism.joints[j].rate)) ** 2))
            if not p[at : at + DRY_FRICTION.keys].any():
                continue

            state = q[:, j], rate, inverse[:, j], p, at
            sliding = dry_law(*state)
            limit = dry_limit(*state)
            required = self._joint_torque(forces, sensor, inverse - applied)
            given = self._torque_per_reading(model, sensor) * reading
            static = np.clip(required + sliding - given, -limit, limit)
            applied[:, j] += standing * (static - sliding)

    def _torque_per_reading(self, model: Any, sensor: Signal) -> float:
        """Torque [N m] at the joint of `sensor` for one unit of its reading, with the
        motor gains of `model`.
        """
        gain, stated = (
            m.actuator_gainprm[sensor.actuator, 0] for m in (model, self._model)
        )
        return float(sensor.gear * (gain / stated))

    def _joint_torque(
        self, forces: Array | None, sensor: Signal, required: Array
    ) -> Array:
        """Torque [N m] of the motor, at the joint of `sensor`, that gives all joints
        the torques `required`, with a value for each time.

        `forces` are those of `FilteredMotion`, of actuators along closed loops; None
        without loops.
        """
        if forces is None:
            return required[:, sensor.joint]
        gear = self._model.actuator_gear[sensor.actuator, 0]
        along = np.einsum("mn,mn->m", forces[:, sensor.actuator], required)
        torque: Array = gear * along
        return torque

    def _readings(self, model: Any, forces: Array | None, required: Array) -> Array:
        """Readings of all torque sensors, a row for each, where the joints bear the
        torques `required`, with a row for each time.
        """
        rows = [
            self._joint_torque(forces, sensor, required)
            / self._torque_per_reading(model, sensor)
            for sensor in self._sensors
        ]
        return np.array(rows)

    def _tracking(self, motion: FilteredMotion, case: Case, deflection: Array) -> Array:
        """Measured minus commanded positions, a row for each that is compared, as the
        delay of commands and the `deflection` of gears cause them.
        """
        delay = case.readings.command
        t = motion.t
        joints = [s.joint for s in self.mechanism.compared("tracking")]
        ahead = delay * motion.v + 0.5 * delay**2 * motion.a
        behind = interpolate_columns(t + delay, t, deflection)
        return -(ahead + behind)[:, joints].T


def _inverse_dynamics(model: Any, q: Array, v: Array, a: Array) -> Array:
    """Torques of rigid bodies, springs, damping and air along a motion, a row for each
    time and a column for each joint, as of the positions `q`.
    """
    data = mujoco.MjData(model)
    torque = np.empty_like(q)
    state = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
    _run_along(model._address, data._address, *state, q, v, a, torque)
    return torque


def _play_deflection(torque: Array, gap: Array | float) -> Array:
    """Angles by which play in the gears, of width `gap` for each joint, leaves the
    links behind the motors, of the same shape as `torque`.
    """
    crossing = PLAY_SMOOTHING * torque.std(axis=0) + 1e-12  # never zero
    behind: Array = 0.5 * gap * np.tanh(torque / crossing)
    return behind


# `mj_inverse` as a C function that compiled loops can call
_LIBRARY = min(Path(mujoco.__file__).parent.glob("libmujoco*"))
llvmlite.binding.load_library_permanently(str(_LIBRARY))
_inverse = types.ExternalFunction("mj_inverse", types.void(types.uintp, types.uintp))


@entry
def _run_along(  # type: ignore[no-untyped-def]
    model,
    data,
    qpos: Array,
    qvel: Array,
    qacc: Array,
    torque: Array,
    q: Array,
    v: Array,
    a: Array,
    out: Array,
) -> None:
    """Write into `out` the torques of inverse dynamics for each row of the positions
    `q`, rates `v` and accelerations `a`.
    """
    for k in range(q.shape[0]):
        qpos[:] = q[k]
        qvel[:] = v[k]
        qacc[:] = a[k]
        _inverse(model, data)
        out[k] = torque
