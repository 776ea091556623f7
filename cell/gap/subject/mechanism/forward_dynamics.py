"""Simulates runs of a mechanism with MuJoCo, many at once, and reads its sensors.

Elastic gears or play split each joint into motor and link.
"""

import copy
from collections.abc import Hashable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from scipy.interpolate import CubicHermiteSpline

from cell.gap.subject.mechanism.effect import Readings
from cell.gap.subject.mechanism.effects import library, torques
from cell.gap.subject.mechanism.inverse_dynamics import InverseDynamics
from cell.gap.subject.mechanism.model import PLANAR, PRESCRIBED, Mechanism, poses
from cell.gap.subject.mechanism.model_source import compile_model
from cell.gap.subject.mechanism.read_mechanism import start_of
from cell.gap.subject.mechanism.recordings import Cut, Recording, Signal
from cell.gap.subject.mechanism.subject import Case, Content, MechanismSubject
from cell.gap.subject.subject import Finding
from drivers.base.errors import ConfigurationError
from drivers.base.geometry import interpolate_columns
from drivers.base.types import Array, frozen

TOGETHER = 256  # simulations of a batch
POSITION_LIMIT = 1e4  # rad or m that no mechanism reaches
TIME_ROUNDING = 1e-9  # s by which a command may be stamped late of the grid
FLEX = "__flex"
COMMAND, EXACT = "command", 1e-9  # of a motor, and its noise [N m or N]
SHARE = 1e-3  # of a joint's inertia that its motor has where the model states none
DAMPED = 0.02  # of critical damping, in the gear
STIFFEST = 1e6  # N m/rad per kg m^2 of a joint's inertia, of a gear that does not twist
LEAST_COMPLIANCE = 1e-12  # rad/(N m), against division by zero
THIRD = 1.0 / 3.0  # of its noise, by which halving the time step may move a signal
BODY = ("body_pos", "body_mass", "body_ipos", "body_iquat", "body_inertia")
DOF = (
    "dof_damping",
    "dof_dampingpoly",
    "dof_armature",
    "dof_frictionloss",
    "dof_solimp",
)
ACTUATOR = ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange")


class Commands(NamedTuple):
    """Commands of a run to the actuators, a row in `u` for each time in `t` [s], each
    held from its time to the next.
    """

    t: Array
    u: Array

    def at_steps(self, step: float, steps: int, delay: Array | float) -> Array:
        """Mean commands in an array of shape (steps, actuators), for time steps of
        `step` [s], where commands act `delay` [s] late.
        """
        if not self.u.shape[1]:
            return np.zeros((steps, 0))

        edges = np.arange(steps + 1) * step - np.sum(delay)
        # the first and the last are held
        every = np.concatenate([edges, self.t])
        begin = every.min() - 1.0
        end = every.max() + 1.0
        times = np.concatenate([[begin], self.t[1:], [end]])
        spans = np.diff(times)[:, None]
        integral = np.cumsum(np.pad(self.u * spans, ((1, 0), (0, 0))), axis=0)
        return np.diff(interpolate_columns(edges, times, integral), axis=0) / step


def commands_of(mechanism: Mechanism, recording: Recording) -> Commands:
    """Commands of the actuators in a recording, at the times of its readings or, where
    a controller held each for a fixed time, on the grid of these times.
    """
    model = mechanism.model
    file = mechanism.file
    read = recording.t
    hold = file.hold
    t = np.arange(0.0, read[-1] + hold, hold) if hold else read
    after = np.searchsorted(read, t + TIME_ROUNDING, side="right")
    row = np.maximum(after - 1, 0)

    u = np.zeros((len(t), model.nu))
    for i in range(model.nu):
        if (name := model.actuator(i).name) in file.inputs:
            u[:, i] = np.interp(read, *recording.known(name))[row]

    return Commands(frozen(t), frozen(u))


def along_motion(mechanism: Mechanism) -> Mechanism | None:
    """Copy of a simulated mechanism for inverse dynamics along its measured motion,
    which compares all torques that are known.

    They are measured ones, and those of motors that commands alone determine. None
    where there are none, where a joint's motion is not measured, or where joints bear
    more than motors give.
    """
    m = mechanism
    model = mechanism.model
    columns = m.places
    if m.mode.group or model.neq or model.npair or len(columns) < model.njnt:
        return None

    by_command = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (
        model.actuator_biastype + model.actuator_dyntype + model.actuator_gaintype == 0
    )
    every = [model.actuator(name) for name in m.file.inputs]
    motors = [motor for motor in every if by_command[motor.id]]
    measured = m.compared("torque")
    signals = (*measured, *(_commanded(model, motor) for motor in motors))

    recordings = []
    for recording in m.recordings:
        read = recording.columns
        known = {joint: read[name] for joint, name in columns.items()}
        known |= {s.name: read[s.name] for s in measured}
        for motor in motors:
            name = motor.name
            known[f"{name} {COMMAND}"] = motor.gainprm[0] * read[name]
        recordings.append(replace(recording, columns=known))

    inputs = dict.fromkeys(columns, "position")
    file = m.file.model_copy(update={"mode": PRESCRIBED.name, "inputs": inputs})
    made = replace(m, file=file, signals=signals, recordings=tuple(recordings))
    return made if signals else None


def _commanded(model: Any, motor: Any) -> Signal:
    """Signal that stands for the force [N m or N] that the command of a `motor` asks of
    it.
    """
    title = f"{motor.name} {COMMAND}"
    return Signal(
        name=title,
        channel=title,
        kind="torque",
        sigma=EXACT,
        zone="middle",
        joint=motor.trnid[0],
        weights=np.zeros(model.njnt),
        floor=EXACT,
        actuator=motor.id,
        gear=motor.gear[0],
    )


class SplitModel:
    """MuJoCo model in which each joint is split into one of the motor and one of the
    link, with an elastic gear or play between them.

    `motor` (joints,) are the indices of the motors' degrees of freedom.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        model = mechanism.model
        split = self._model = compile_model(
            mechanism.source,
            origin=mechanism.file.name,
            slots=model.nuser_jnt,
            step=model.opt.timestep,
            edit=self._add_flexible_joints,
        )
        split.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
        self.motor = np.array(
            [split.joint(joint.name).id for joint in mechanism.joints]
        )
        self._flex = np.setdiff1d(np.arange(split.njnt), self.motor)
        for field in ("dof_armature", "dof_frictionloss", "dof_dampingpoly"):
            # whatever the model's defaults are
            getattr(split, field)[self._flex] = 0.0

    def _add_flexible_joints(self, spec: Any) -> None:
        """Add to each joint of a model's specification a second one about the same
        axis, for the motion of the link on its gear.
        """
        for joint in spec.joints:
            flex = joint.parent.add_joint(name=joint.name + FLEX, type=joint.type)
            flex.axis = joint.axis
            flex.pos = joint.pos
            flex.armature = 1.0  # 0 once compiled
            flex.limited = mujoco.mjtLimited.mjLIMITED_FALSE

    def soft(self, edited: Any, readings: Readings) -> Any:
        """Copy of the split model that has the fields of the `edited` model, and the
        gears that `readings` state.
        """
        found = copy.copy(self._model)
        found.opt.gravity[:] = edited.opt.gravity
        found.opt.density = edited.opt.density
        for name in (*BODY, *ACTUATOR):
            getattr(found, name)[:] = getattr(edited, name)
        for name in DOF:
            getattr(found, name)[self.motor] = getattr(edited, name)
        self._set_gears(found, edited, readings)
        mujoco.mj_setConst(found, mujoco.MjData(found))
        return found

    def _inertias(self, found: Any) -> tuple[Array, Array]:
        """Inertias of the links and of the motors, of which each motor gets a small
        share of its link's inertia where it has none in the model `found`.
        """
        links = self._mechanism.inertia
        motors = np.maximum(found.dof_armature[self.motor], SHARE * links)
        found.dof_armature[self.motor] = motors
        return links, motors

    def _set_gears(self, found: Any, edited: Any, readings: Readings) -> None:
        """Set the gears in the split model `found`: their stiffness [N m/rad] and play
        [rad] as `readings` state them, and a damping that suits these.

        Springs and parameters of compiled torque laws are those of `edited`, which has
        no gears.
        """
        links, motors = self._inertias(found)
        flex = self._flex
        motor = self.motor
        user = found.jnt_user
        compliance = np.maximum(readings.elastic, LEAST_COMPLIANCE)
        gap = readings.gap
        stiffness = np.minimum(1.0 / compliance, STIFFEST * links)
        for name in ("jnt_stiffness", "qpos_spring"):
            getattr(found, name)[motor] = getattr(edited, name)

        if np.any(gap):
            has_play = np.greater(gap, 0.0)
            stiffness = np.where(has_play, 0.0, stiffness)
            width = np.where(has_play, gap, 0.0)
            found.jnt_range[flex] = np.outer(width, (-0.5, 0.5))
            found.jnt_limited[flex] = has_play

        found.jnt_stiffness[flex] = stiffness
        ringing = np.sqrt(np.maximum(stiffness, 1.0) * motors)
        found.dof_damping[flex] = 2.0 * DAMPED * ringing
        user[:] = 0.0
        user[motor] = edited.jnt_user
        user[:, 0] = found.njnt
        user[:, 1] = np.mean(edited.jnt_user[:, 1])


class PivotModel(SplitModel):
    """Model of a chain of hinges, such as a pendulum, whose pivot slides sideways on a
    spring.
    """

    def _add_flexible_joints(self, spec: Any) -> None:
        """Add a slide at the pivot before the first hinge of a model's specification;
        the hinge is made anew, because joints of one body move in their order.
        """
        first = spec.joints[0]
        body = first.parent
        name = first.name
        axis = first.axis.copy()
        spec.delete(first)
        body.add_joint(
            name=FLEX, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1.0, 0.0, 0.0)
        )
        body.add_joint(name=name, axis=axis)

    def _inertias(self, found: Any) -> tuple[Array, Array]:
        """Mass [kg] that the pivot bears, once as the inertia of the link and once as
        that of the motor.
        """
        mass = np.array([found.body_mass.sum()])
        return mass, mass


class ForwardDynamics(MechanismSubject):
    """Measured runs of a mechanism whose signals are predicted by a simulation that the
    recorded commands drive.
    """

    def __init__(
        self, mechanism: Mechanism, jobs: int = 1, without: Sequence[str] = ()
    ) -> None:
        super().__init__(mechanism, jobs, without)
        # `predict` says what diverges; MuJoCo would write a log beside the user's files
        mujoco.set_mju_user_warning(lambda _: None)
        self._laws = frozenset(  # which a simulation adds to MuJoCo's own forces
            e.name
            for e in library().values()
            if e.law and e.applies(mechanism) and not e.by_fields(mechanism)
        )
        self._settle = round(
            (mechanism.file.start.settle or 0.0) / mechanism.model.opt.timestep
        )
        self._data = mujoco.MjData(mechanism.model)
        self.runs = tuple(map(self._run, mechanism.recordings))

    @cached_property
    def _split_model(self) -> SplitModel:
        make = PivotModel if self.mechanism.mode is PLANAR else SplitModel
        return make(self.mechanism)

    def check(self, origin: str) -> None:
        """Raise ConfigurationError for a model that cannot be simulated, or for a time
        step whose half changes a run by more than a third of its noise.
        """
        super().check(origin)
        mechanism = self.mechanism
        model = copy.copy(self.mechanism.model)
        model.opt.timestep = 0.5 * mechanism.file.step
        halved = replace(mechanism, model=model, recordings=mechanism.recordings[:1])
        finer = ForwardDynamics(halved)._stated_residuals()
        run = self.runs[0]
        moved = np.abs(self._stated_residuals() - finer)
        change = np.nanmax(moved / run.samples.reading)
        if change > THIRD:
            raise ConfigurationError(
                f"{origin}: step: half of it moves run {run.name} by {change:.2g} of"
                f" its noise, at most {THIRD:.2f} is allowed; make it smaller"
            )

    def contradictions(self) -> Iterator[Finding]:
        """Findings on the recordings, and on measured torques and commands in another
        unit or of another sign than the model's along the measured motion.

        When commands act is for the fit to find, as control_delay.
        """
        yield from super().contradictions()
        along = along_motion(self.mechanism)
        if along is not None:
            with suppress(ConfigurationError):  # the other mode would leave parts out
                findings = [*InverseDynamics(along).judge()]
                yield from (each for each in findings if each.what != "lag")

    def not_honoured(self) -> Iterator[str]:
        """Names of the parts of the model that the torques read from a simulation would
        ignore, such as actuators that are not affine.
        """
        model = self.mechanism.model
        plain = (model.actuator_dyntype == 0) & (model.actuator_gaintype == 0)
        plain &= model.actuator_biastype <= int(mujoco.mjtBias.mjBIAS_AFFINE)
        plain &= model.actuator_delay == 0.0
        for sensor in self._sensors:
            if not plain[sensor.actuator]:
                name = model.actuator(sensor.actuator).name
                yield (
                    f"torque {sensor.name} of {name}: its filter, delay, or law of"
                    " force"
                )

    def _content(self, recording: Recording, cut: Cut) -> Content:
        """Readings `cut` from a run, with the commands and the start that its
        simulation needs.
        """
        mechanism = self.mechanism
        commands = commands_of(mechanism, recording)
        start = start_of(mechanism, recording)
        speed = np.gradient(cut.values[0], cut.t)
        return Content(cut, speed, recording.load, commands=commands, start=start)

    def predict(self, cases: Sequence[Case]) -> list[Array | None]:
        """Predicted signals of each of `cases`, as an array of shape (signals,
        readings); None where the simulation diverges.
        """
        by_motion: dict[Hashable, list[int]] = {}
        ends = [case.content.cut.t[-1] for case in cases]
        for i in np.argsort(ends, kind="stable").tolist():
            by_motion.setdefault(cases[i].motion, []).append(i)
        groups = [*by_motion.values()]
        found: dict[int, Array] = {}
        for begin in range(0, len(groups), TOGETHER):
            found |= self._predict_together(cases, groups[begin : begin + TOGETHER])
        return [*map(found.get, range(len(cases)))]

    def _predict_together(
        self, cases: Sequence[Case], groups: Sequence[Sequence[int]]
    ) -> dict[int, Array]:
        """Predicted signals by the index of each case, a row for each signal, where the
        cases of each group of indices in `groups` share one simulation.
        """
        simulated = self._simulate([cases[i] for i, *_ in groups])
        found = {}
        for group, states, control, model in zip(groups, *simulated, strict=True):
            if not np.abs(states).max() < POSITION_LIMIT:
                continue
            grid = np.arange(len(states)) * model.opt.timestep
            places, rates = states.swapaxes(0, 1)
            positions = CubicHermiteSpline(grid, places, rates)
            for i in group:
                case = cases[i]
                t = np.maximum(case.content.cut.t - case.readings.delay, 0.0)
                q = positions(t).T
                v = interpolate_columns(t, grid, rates).T
                found[i] = self._read(case, t, q, v, control, model)
        return found

    def _simulate(self, cases: Sequence[Case]) -> tuple[Array, Array, list[Any]]:
        """Simulated states of `cases`, the commands at each time step, and the edited
        models; a state holds positions and rates of all joints for each time step.
        """
        stated = self.mechanism.model
        step = stated.opt.timestep
        span = max(c.content.cut.t[-1] for c in cases)
        steps = int(np.ceil(span / step)) + 2
        readings = [c.readings for c in cases]
        commands = [
            c.content.commands.at_steps(step, steps, read.command)
            for c, read in zip(cases, readings, strict=True)
        ]
        settled = (self._settle, 0)  # steps in which the first command is held
        control = np.pad(commands, ((0, 0), settled, (0, 0)), mode="edge")
        models = [case.edited(stated) for case in cases]
        for model in models:
            mujoco.mj_setConst(model, self._data)

        states = self._roll_out(models, cases, control)
        soft = [np.any(read.elastic) or np.any(read.gap) for read in readings]
        if rows := np.flatnonzero(soft).tolist():
            some, of_them = ([each[i] for i in rows] for each in (cases, models))
            states[rows] += self._by_gears(of_them, some, control[rows])

        return states, control, models

    def _roll_out(
        self,
        models: Sequence[Any],
        cases: Sequence[Case],
        control: Array,
        into: Any = slice(None),
    ) -> Array:
        """Simulated states of `cases`, each from its start under its commands in
        `control`: positions and rates of joints for each time step.

        Those of the mechanism's joints go `into` degrees of freedom of the models.
        """
        first = models[0]
        state = ("qpos", "qvel")
        batch = Batch(first, len(models), self._jobs)
        batch.set_models(models)
        start = np.array([case.start for case in cases])
        for name, values in zip(state, start.swapaxes(0, 1), strict=True):
            batch.bind(name)[:, into] = values

        count, steps, _ = control.shape
        with torques().install(self._laws, first):
            try:
                out = batch.rollout(steps, control, record=state)
            except SimulationError:
                left = steps - self._settle + 1
                return np.full((count, left, *start.shape[1:]), np.inf)

        states = np.stack([out[name][..., into] for name in state], axis=2)
        states = np.concatenate([start[:, None], states], axis=1)
        states[batch.warning.reshape(count, -1).any(axis=1)] = np.inf
        return states[:, self._settle :]

    def _by_gears(
        self, models: Sequence[Any], cases: Sequence[Case], control: Array
    ) -> Array:
        """Change of the states of `cases` by elastic gears or play: those of split
        models less those of the same models with rigid gears.
        """
        made = self._split_model
        pairs = zip(models, cases, strict=True)
        soft = [made.soft(model, case.readings) for model, case in pairs]
        rigid = [copy.copy(model) for model in models]
        for model, split in zip(rigid, soft, strict=True):
            model.opt.integrator = split.opt.integrator
        moved = self._roll_out(soft, cases, control, made.motor)
        return moved - self._roll_out(rigid, cases, control)

    def _read(
        self, case: Case, t: Array, q: Array, v: Array, control: Array, model: Any
    ) -> Array:
        """Predicted sensor readings, a row for each signal and a column for each time
        in `t` [s], from the joint positions `q` and rates `v` at these times.
        """
        mechanism = self.mechanism
        errors = case.readings
        signals = mechanism.signals
        rows = np.empty((len(signals), len(t)))
        sensed = {"site", "sensor"} & {s.kind for s in signals}
        along = poses(model, q.T, mujoco.mj_forward, v.T) if sensed else ()
        sensors = np.array([np.append(d.site_xpos, d.sensordata) for d in along]).T

        for k, signal in enumerate(signals):
            match signal.kind:
                case "torque":
                    rows[k] = self._torque(signal, model, q, v, control, t)
                case "site" | "sensor":
                    rows[k] = sensors[signal.joint]
                case kind:
                    rows[k] = signal.weights @ (q if kind == "position" else v)

        encoders = mechanism.mode.encoders(mechanism)
        read = [k for k, s in enumerate(signals) if s.name in encoders]
        scale, bias = (np.reshape(x, (-1, 1)) for x in (errors.scale, errors.bias))
        rows[read] = (1.0 + scale) * rows[read] + bias
        return rows

    def _torque(
        self, signal: Signal, model: Any, q: Array, v: Array, control: Array, t: Array
    ) -> Array:
        """Predicted readings of a torque `signal`, one for each time in `t` [s], from
        the joint states and the commands `control`.
        """
        actuator = signal.actuator
        joint = signal.joint
        (gain, *_), (constant, of_place, of_rate, *_), limits = (
            getattr(model, name)[actuator] for name in ACTUATOR
        )
        gear = model.actuator_gear[actuator, 0]
        step = self._settle + (t / model.opt.timestep).astype(int)
        u = control[np.minimum(step, len(control) - 1), actuator]
        if model.actuator_ctrllimited[actuator]:
            u = np.clip(u, *model.actuator_ctrlrange[actuator])

        force = (
            gain * u + constant + of_place * gear * q[joint] + of_rate * gear * v[joint]
        )
        torque: Array = np.clip(force, *limits) * gear / signal.gear
        return torque
