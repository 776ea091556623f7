"""Reads a mechanism's file, model and runs, and checks them against one another."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

import mujoco
import numpy as np

from cell.gap.subject.mechanism.effects import check_effects, torques
from cell.gap.subject.mechanism.mechanism_file import (
    MechanismFile,
    SignalSpec,
)
from cell.gap.subject.mechanism.model import (
    MODES,
    PLANAR,
    Joint,
    Mechanism,
    PredictionMode,
    actuator_on,
    base_of,
    check_joints,
    number_of,
    poses,
    typical_loads,
)
from cell.gap.subject.mechanism.model_source import (
    compile_model,
    read_source,
    with_assets,
)
from cell.gap.subject.mechanism.recordings import (
    Recording,
    Signal,
    read_recording,
    repeat_noise,
    typical_frequency,
)
from cell.gap.subject.run_folders import RunFolder, check_indices
from cell.gap.subject.subject import Origin
from cell.record.files import ANGLES, RUN
from drivers.base.errors import ConfigurationError
from drivers.base.settings import load
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

# rad of the fastest swing between two readings; rad of a small one
SPARSEST, SMALL = 0.8, 1e-4
FLOOR = 0.02  # of a torque's standard deviation: modelling error of rigid bodies
FORWARD_FLOOR = 5e-5  # rad or m, error of integration
# MuJoCo's impedance of dry friction, which lets joints creep
SOFT = (0.9, 0.95, 0.001, 0.5, 2.0)
# impedance of dry friction that holds a joint, where the model states none
FIRM = 0.9999
LIMITLESS = 1e12  # N m or N, force range of an actuator that states none
# N m, typical torque of a joint that neither weight nor motion loads
LEAST_TORQUE = 1e-9
LEAST_WEIGHT = 1e-12  # N m, weight by which a joint without gravity would swing
TURN = 2.0 * np.pi  # rad
SIDES = {"joint": "joint", "actuator": "motor"}  # of a gear, where a file states none
LEAST = 8  # readings of which the rate at the start is taken
RATE_READINGS = 300  # of a recording, from which typical rates are taken


def model_place(file: MechanismFile, path: Path) -> Path:
    """Path of the model that the mechanism's `file` at `path` names; ConfigurationError
    where it lies outside the folder of that file.
    """
    folder = path.resolve().parent
    place = (folder / file.model).resolve()
    if Path(file.model).is_absolute() or not place.is_relative_to(folder):
        raise ConfigurationError(
            f"{path}: model: {file.model} lies outside {folder}; paths stay in the"
            " file's folder"
        )
    return place


def open_file(path: Path, model: Path | None = None) -> Mechanism:
    """Mechanism that the file at `path` describes, still without recordings, joints and
    the noise of its signals.

    With another `model` it has no effects but those that this states. Joints and
    recordings are left open, too. Raises ConfigurationError for anything broken.
    """
    origin = Origin.before_reading(path, "--model")
    file = load(path, MechanismFile)
    if file.cell:  # the cell's own, whose effects may belong into its file
        origin = replace(origin, option=f"--subject {quote(path.parent.name)}")

    model_path = model_place(file, path)
    folder = path.resolve().parent
    if model:
        model_path = model.resolve()
        folder = model_path.parent
        file = file.model_copy(update={"effects": {}})

    # a URDF has no motors: they are where torques are read or commanded
    moved = [signal.name for signal in file.signals.values() if signal.is_ == "torque"]
    moved += [name for name, kind in file.inputs.items() if kind != "position"]
    source = replace(read_source(model_path, folder), motors=tuple(moved))
    source = with_assets(source, str(model_path))
    compiled = compile_model(source, str(model_path), torques().slots, file.step)
    check_joints(compiled, str(model_path))
    _check_inputs(file, compiled, str(path))

    mode = MODES[file.mode]
    signals = [
        _signal(name, spec, mode, compiled, str(path))
        for name, spec in file.signals.items()
    ]
    if mode.loads:
        order = ("torque", "tracking")
        signals = [each for each in signals if each.kind in order]
        signals.sort(key=lambda each: order.index(each.kind))

    origin = replace(origin, digests={**origin.digests, **source.digests})
    return Mechanism(
        file=file,
        path=path,
        source=source,
        model=compiled,
        signals=tuple(signals),
        origin=origin,
    )


def open_all(path: Path, folders: Sequence[RunFolder], model: Path | None) -> Mechanism:
    """Mechanism that the file at `path` describes, with the measured runs in `folders`,
    and with another `model` unless that is None.
    """
    found = open_file(path, model)
    read = [read_checked(folder, found) for folder in folders]
    check_indices([f.path for f in folders], [r.index for r in read])
    file = found.file
    recordings = tuple(sorted(read, key=lambda r: r.index or 0))
    specs = file.signals
    moving = [n for n, kind in file.inputs.items() if kind == "position"]
    moving += [n for n, s in specs.items() if s.is_ not in ("torque", "tracking")]
    signals = [
        _with_noise(signal, specs[signal.name], recordings, str(path))
        for signal in found.signals
    ]
    found = replace(
        found,
        recordings=recordings,
        pace=typical_frequency(recordings, moving),
        signals=tuple(signals),
    )
    found = replace(found, joints=_measured_joints(found))
    _set_options(found)
    check_effects(found)
    return replace(found, base=base_of(found))


def read_checked(folder: RunFolder, mechanism: Mechanism) -> Recording:
    """Recording in `folder`; ConfigurationError where it contradicts the file or the
    model of `mechanism`.
    """
    model = mechanism.model
    is_hinge = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    hinges = [model.joint(i).name for i in range(model.njnt) if is_hinge[i]]
    recording = read_recording(folder, mechanism.file, hinges)
    apart = np.median(np.diff(recording.t))
    if mechanism.mode is PLANAR and apart > (most := SPARSEST / _fastest_swing(model)):
        raise ConfigurationError(
            f"{folder.path / ANGLES}: t: rows are {apart:g} s apart, at most {most:.2g}"
            " s shows this pendulum's swings; t is in s"
        )

    if load := recording.load:
        number_of(
            model,
            kind="body",
            name=load.body,
            origin=f"{recording.name}: {RUN}: load",
            key="body",
        )

    return recording


def _fastest_swing(model: Any) -> float:
    """Angular frequency [rad/s] of the fastest small swing of a chain, such as a
    pendulum, that hangs at rest at angle zero.
    """
    offsets = SMALL * np.eye(model.nv)
    mass = np.zeros_like(offsets)
    (data,) = poses(model, [model.qpos0], mujoco.mj_forward)
    mujoco.mj_fullM(model, data, mass)
    swung = poses(model, offsets, mujoco.mj_forward)
    stiffness = [data.qfrc_bias / SMALL for data in swung]
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    return float(np.sqrt(squares.max()))


def _check_inputs(file: MechanismFile, model: Any, origin: str) -> None:
    """Raise ConfigurationError where the mechanism's `file` lists inputs of joints or
    motors that the `model` does not have.
    """
    for name, is_ in file.inputs.items():
        kind = "joint" if is_ == "position" else "actuator"
        number_of(model, kind, name, origin=origin, key=f"inputs.{name}")


def _signal(
    name: str, spec: SignalSpec, mode: PredictionMode, model: Any, origin: str
) -> Signal:
    """Signal in the column `name` of a recording, as the entry `spec` of the
    mechanism's file states it, still without its noise.

    In a `mode` with a group, positions of joints are sums with those before.
    Raises ConfigurationError for what the model lacks, and for a torque of no motor on
    a joint.
    """
    key = f"signals.{name}"
    owner = spec.owner
    number = number_of(model, kind=owner, name=spec.name, origin=origin, key=key)
    kind = spec.is_ or owner
    joint = -1
    actuator = -1
    gear = 1.0
    weights = np.zeros(model.njnt)
    if kind == "torque":
        actuator = number if owner == "actuator" else actuator_on(model, number)
        joint = _driven_joint(model, actuator)
        if joint < 0:
            raise ConfigurationError(
                f"{origin}: {key}: {owner} {spec.name} drives no joint; compare torques"
                " of motors on joints"
            )
        if (spec.side or SIDES[owner]) == "motor":
            gear = model.actuator_gear[actuator, 0]
    elif owner == "joint":
        joint = number
        weights[0 if mode.group else joint : joint + 1] = kind != "tracking"
    elif spec.axis:
        joint = 3 * number + "xyz".index(spec.axis)
    else:
        weights = _sum_of_joints(model, number)
        if weights.any():
            kind = "position"
        else:
            joint = 3 * model.nsite + model.sensor_adr[number]

    # parts of a chain
    ends = {model.njnt - 1: "grasped", 0: "fixed"}
    zone = "grasped" if kind in ("site", "sensor") else ends.get(joint, "middle")
    return Signal(
        name=name,
        channel=mode.group or name,
        kind=kind,
        sigma=0.0,
        zone=zone,
        joint=joint,
        weights=weights,
        floor=FORWARD_FLOOR,
        actuator=actuator,
        gear=gear,
    )


def _with_noise(
    signal: Signal, spec: SignalSpec, recordings: Sequence[Recording], origin: str
) -> Signal:
    """Copy of `signal` with its noise, which `spec` states or repeated recordings show,
    and with the error that every model has of a torque.
    """
    name = signal.name
    floor = signal.floor
    sigma = spec.sigma
    if sigma == "repeats":
        sigma = repeat_noise(recordings, name, origin)
    if signal.kind == "torque":
        floor = FLOOR * np.nanstd(
            np.concatenate([recording.columns[name] for recording in recordings])
        )
    return replace(signal, sigma=sigma, floor=floor)


def _driven_joint(model: Any, actuator: int) -> int:
    """Number of the joint that the actuator with the number `actuator` drives; -1 where
    it drives none.
    """
    is_on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    if actuator < 0 or not is_on_joint[actuator]:
        return -1
    return int(model.actuator_trnid[actuator, 0])


def _sum_of_joints(model: Any, number: int) -> Array:
    """Weights, one for each joint, with which the sensor numbered `number` adds up
    joint positions; zeros for any other kind of sensor.
    """
    row = np.zeros(model.njnt)
    sensor = model.sensor(number)
    kind = sensor.type[0]
    number = sensor.objid[0]
    if kind == mujoco.mjtSensor.mjSENS_JOINTPOS:
        row[number] = 1.0
    elif kind == mujoco.mjtSensor.mjSENS_TENDONPOS:
        first = model.tendon_adr[number]
        for w in range(first, first + model.tendon_num[number]):
            if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT:
                row[model.wrap_objid[w]] += model.wrap_prm[w]

    return row


def _set_options(mechanism: Mechanism) -> None:
    """Give every actuator of the mechanism's model a force range, and switch off
    contacts unless the model lists pairs of geoms.

    The first user numbers of joints are those that laws of torque need.
    """
    model = mechanism.model
    model.jnt_user[:, 0] = model.njnt
    model.jnt_user[:, 1] = mechanism.mode.smoothing(mechanism.rate)
    free = model.actuator_forcelimited == 0
    model.actuator_forcerange[free] = (-LIMITLESS, LIMITLESS)
    model.actuator_forcelimited[:] = 1
    model.dof_solimp[(model.dof_solimp == SOFT).all(axis=1), :2] = FIRM
    if model.npair == 0:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT

    # a chain is one island, which is not worth a search at each stage of each step
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND


def _measured_joints(mechanism: Mechanism) -> tuple[Joint, ...]:
    """Joints of the mechanism's model, each with the rate and torque that are typical
    of it in the recordings.

    Where nothing was measured, gravity and inertia in poses drawn at random are
    typical.
    """
    model = mechanism.model
    recordings = mechanism.recordings
    columns = mechanism.places
    hinges = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
    squares = {
        s.joint: [
            np.nanmean((s.gear * recording.columns[s.name]) ** 2)
            for recording in recordings
        ]
        for s in mechanism.compared("torque")
    }

    found = []
    loads = zip(*typical_loads(model), hinges.tolist(), strict=True)
    for i, (weight, inertia, hinge) in enumerate(loads):
        rate = 0.0
        acceleration = 0.0
        travel = TURN
        name = model.joint(i).name
        if name in columns:
            rate, acceleration, travel = _motion(recordings, columns[name])

        driven = np.sqrt(np.mean(squares.get(i, 0.0)))
        torque = driven or max(weight, inertia * acceleration, LEAST_TORQUE)
        pace = rate or np.sqrt(max(weight, LEAST_WEIGHT) / inertia)
        motor = actuator_on(model, i)
        found.append(
            Joint(
                name=name,
                hinge=hinge,
                actuator=motor,
                torque=torque,
                rate=pace,
                inertia=inertia,
                travel=travel,
            )
        )

    return tuple(found)


def _motion(recordings: Sequence[Recording], column: str) -> tuple[float, float, float]:
    """Root mean square of the rate and of the acceleration of the position in `column`,
    over all recordings, and its largest range in one.
    """
    squares = []
    travels = []
    for recording in recordings:
        known = np.array(recording.known(column))
        t, x = known[:, :: max(1, known.shape[1] // RATE_READINGS)]
        v = np.gradient(x, t)
        squares.append([np.mean(v**2), np.mean(np.gradient(v, t) ** 2)])
        travels.append(np.ptp(x))
    rate, acceleration = np.sqrt(np.mean(squares, axis=0))
    return rate, acceleration, max(travels)


def start_of(mechanism: Mechanism, recording: Recording) -> tuple[Array, Array]:
    """Positions [rad or m] and rates of the joints at the start of a recording, each of
    shape (joints,).
    """
    spec = mechanism.file.start
    count = len(mechanism.joints)
    compared = mechanism.compared("position")
    weights = np.array([signal.weights for signal in compared]).reshape(-1, count)
    inverse = np.linalg.pinv(weights)
    near = max(LEAST, int(np.searchsorted(recording.t, 0.5 / mechanism.pace)))

    positions = []
    slopes = []
    for signal in compared:
        t, x = recording.known(signal.name)
        begin = np.searchsorted(t, recording.t[near - 1], side="right")
        fitted = np.polynomial.Polynomial.fit(t[:begin], x[:begin], 3)
        positions.append(x[0])
        slopes.append(fitted.deriv()(0.0))

    rates = slopes if recording.rates is None else recording.rates
    q = inverse @ positions
    v = inverse @ rates
    if spec.position != "measured":
        q = np.full(count, spec.position)
    if spec.velocity != "measured":
        v = np.full(count, spec.velocity)
    return q, v


def initial_state(
    mechanism: Mechanism, start: Sequence[Array]
) -> tuple[Parameter, ...]:
    """Unknown positions and rates of the joints at the start of a run, as parameters to
    be fitted about `start`, two arrays of shape (joints,).
    """
    spec = mechanism.file.start
    spread = np.inf if spec.spread is None else spec.spread
    if not spread or spec.settle:
        return ()
    found = []
    units = ("rad", 1.0), ("rad/s", mechanism.pace)
    for names, (unit, times), values in zip(
        _start_names(mechanism), units, start, strict=True
    ):
        for name, value in zip(names, values, strict=True):
            found.append(
                Parameter(name, unit, value, step=1e-5 * times, spread=spread * times)
            )
    return tuple(found)


def stated_start(
    mechanism: Mechanism, unknowns: Mapping[str, float]
) -> tuple[Array, ...]:
    """Positions and rates of the joints at the start of a run, of shape (joints,) each,
    out of its `unknowns`; empty where the file fixes them.
    """
    angles, rates = _start_names(mechanism)
    if angles[0] not in unknowns:
        return ()
    return (
        np.array([unknowns[name] for name in angles]),
        np.array([unknowns[name] for name in rates]),
    )


def _start_names(mechanism: Mechanism) -> tuple[list[str], list[str]]:
    """Names of the unknown positions at the start of a run, one for each joint, and
    names of the unknown rates.
    """
    names = [joint.name for joint in mechanism.joints]
    return [f"angle_{name}" for name in names], [f"rate_{name}" for name in names]
