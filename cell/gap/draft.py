"""Draft of a mechanism's file and of a mapping, from a model and tables of its motion.

Names of columns tell joints and quantities, ranges tell units, and the torques that the
model itself needs tell scale, sign and side of the gear. What cannot be told stays
open, a null, which the import refuses by its name.
"""

import json
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa

from cell.gap.open_subject import open_mechanism
from cell.gap.subject.mechanism.inverse_dynamics import InverseDynamics
from cell.gap.subject.mechanism.model import actuator_on, check_joints
from cell.gap.subject.mechanism.model_source import compile_model, read_source
from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.run_folders import RunFolder
from cell.record.exchange.guess import (
    Guess,
    columns_by_name,
    told_by,
    with_unit,
    words_of,
)
from cell.record.exchange.import_runs import sources_in, write_run
from cell.record.exchange.mapping import UNITS, SignalMapping, Source, Table
from cell.record.tables import NAMED as LISTED, numbers_of, with_named_parts
from drivers.base.errors import ConfigurationError
from drivers.base.files import write_file
from drivers.base.geometry import robust_sigma
from drivers.base.readers import read_json
from drivers.base.settings import Settings, parse
from drivers.base.yaml_text import dump_yaml, parse_yaml

MODES = {"prescribed": ("position", "torque"), "forward": ("ctrl", "position")}
"""Kinds of columns that are inputs and signals, by mode."""
SCALED = {"current", "strom", "load"}  # a torque but for the motor's constant
ROLES = {"joint", "motor", "actuator", "act"}  # words of a name that tell no joint
SPREADS = [
    {"body": "*", "field": "mass", "spread": "2%"},
    {"joint": "*", "field": "damping", "spread": "20%"},
]
"""What is usually known; an error in any other number of the model is named."""
OF_TORQUE = 0.05  # of a torque's size, its error where nothing better is known
QUIETEST = 1e-4  # rad or m, noise of a position
MOST_RUNS = 12  # that are read for a draft
STEP, TYPICAL_STEP = 0.002, 0.01  # s, of the simulation and between rows
TURN = 2.1 * np.pi  # rad, beyond which an angle is in degrees
COUNTS = 4095 / 360  # of a servo's encoder in a degree, as LeRobot takes them
NAMED, PLACED = "its name", "its place"  # reasons
HEAD = (
    "# drafted: the error of a torque is 5 % of its size, spreads are usual ones;"
    " state what is known\n"
)


class Servo(Settings):
    """Range of a servo in counts of its encoder, as LeRobot calibrated it."""

    range_min: int
    range_max: int


@dataclass(frozen=True, slots=True)
class JointColumn:
    """Column of the `file` of a run that holds a `kind` of quantity of the named
    `joint`, with the `guess` at its unit.

    Of a torque, `side` says where it is not the joint's side of the gear; `scale` is
    the factor of its unit by the model, where that is open.
    """

    file: str
    kind: str
    joint: str
    guess: Guess
    side: str = ""
    scale: float = 1.0

    def told(self, side: str = "", scale: float = 1.0, **known: Any) -> "JointColumn":
        """Copy of which more is known, also of its guess."""
        guess = replace(self.guess, **known)
        return replace(self, guess=guess, side=side, scale=scale)

    def with_factor(self) -> "JointColumn":
        """Copy whose factor is not open."""
        return self.told(factor=self.guess.factor or self.scale)


@dataclass(frozen=True, slots=True)
class Draft:
    """Draft of the files of a mechanism whose `model`, `compiled`, moved as `columns`
    say, each under the name of a signal or an input.

    `times` are those of the files of a run; `remarks` say what is left out.
    """

    model: Path
    compiled: Any
    mode: str
    columns: Mapping[str, JointColumn]
    times: Mapping[str, Guess]
    remarks: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the mechanism, after its model's file."""
        return "-".join(re.findall("[A-Za-z0-9]+", self.model.stem)) or "robot"

    def told(self, known: Mapping[str, Mapping[str, Any]]) -> "Draft":
        """Copy in which more is `known` of columns by name."""
        columns = {n: each.told(**known.get(n, {})) for n, each in self.columns.items()}
        return replace(self, columns=columns)

    def robot(self) -> str:
        """Text of the mechanism's file."""
        signals: dict[str, dict[str, Any]] = {}
        inputs = {}
        for name, each in self.columns.items():
            if each.kind == MODES[self.mode][0]:
                inputs[name] = each.kind
                continue
            stated = {"joint": each.joint, "is": each.kind, "sigma": _error(each)}
            signals[name] = stated | ({"side": each.side} if each.side else {})
        about: dict[str, Any] = {"schema": 1, "kind": "mechanism", "name": self.name}
        about |= {"model": self.model.name, "mode": self.mode}
        about |= {"signals": signals, "inputs": inputs, "uncertain": SPREADS}
        if self.mode == "forward":
            rows = next(iter(self.times.values())).si()
            about["hold"] = float(f"{np.median(np.diff(rows)):.3g}")
        return HEAD + dump_yaml(about)

    def mapping(self) -> str:
        """Text of the mapping file."""
        lines = ["schema: 1", f"mechanism: {self.name}", "signals:"]
        for file, time in self.times.items():
            lines += [f"- file: {json.dumps(file)}", "  columns:", time.line("t")]
            own = [(n, each) for n, each in self.columns.items() if each.file == file]
            lines += [each.guess.line(json.dumps(name)) for name, each in own]
        return "\n".join((*lines, *(f"# {remark}" for remark in self.remarks), ""))


def draft_mechanism(model: Path, places: Sequence[Path]) -> Draft:
    """Draft a mechanism's file and a mapping from the MJCF or URDF file `model` and the
    runs in `places`, among which may be a LeRobot calibration, a .json file.

    Raises ConfigurationError for a model or runs that cannot be read, and where no
    column is the position of a joint.
    """
    calibrations = [place for place in places if place.suffix == ".json"]
    found = (sources_in(place) for place in places if place not in calibrations)
    runs = [*islice(chain.from_iterable(found), MOST_RUNS)]
    if not runs:
        raise ConfigurationError("--guess: no run is given; give tables or a data set")
    source = read_source(model, model.resolve().parent)
    compiled = compile_model(source, str(model), slots=0, step=STEP)
    check_joints(compiled, str(model))

    tables = {file: _table(runs, file, _joints(compiled)) for file in runs[0].names}
    times = {
        file: with_unit(time, "t", TYPICAL_STEP)
        for file, table in tables.items()
        if (time := columns_by_name(table).get("t"))
    }
    columns, remarks = _assigned(
        {file: tables[file] for file in times}, times, compiled
    )
    kinds = {each.kind for each in columns}
    if "position" not in kinds:
        names = [name for table in tables.values() for name in table.column_names]
        raise ConfigurationError(
            f"{runs[0].path}: no column is the position of a joint of {model}; its"
            f" joints: {', '.join(_joints(compiled))}; columns:"
            f" {', '.join(names[:LISTED])}"
        )
    mode = "prescribed" if "torque" in kinds else "forward"
    servos = {
        name: parse(stated, Servo, f"{path}: {name}", "ignore")
        for path in calibrations
        for name, stated in read_json(path).items()
    }
    named = {
        _name(each, mode, compiled): _with_unit(each, columns, compiled, servos)
        for each in columns
        if each.kind in MODES[mode]
    }
    aside = [each.guess.column for each in columns if each.kind not in MODES[mode]]
    if aside:
        remarks.append(f"not taken: mode {mode} has no place for {', '.join(aside)}")
    used = {each.file for each in named.values()}
    times = {file: time for file, time in times.items() if file in used}
    return _tried(Draft(model, compiled, mode, named, times, tuple(remarks)), runs)


def _table(runs: Sequence[Source], file: str, joints: Sequence[str]) -> pa.Table:
    """Table `file` of all `runs`, one after another; parts of lists that messages call
    by names of `joints` are columns of their own.
    """
    how = Table[str](file=file, columns={})
    content = pa.concat_tables(
        [run.table(how) for run in runs], promote_options="default"
    )
    stems = dict.fromkeys(name.rpartition(".")[0] for name in content.column_names)
    wanted = [f"{stem}.{joint}" for stem in stems for joint in joints]
    return with_named_parts(content, wanted, file)


def _assigned(
    tables: Mapping[str, pa.Table], times: Mapping[str, Guess], model: Any
) -> tuple[list[JointColumn], list[str]]:
    """Columns of the `tables` of files that belong to joints of `model`, one of each
    kind for a joint, and remarks on all others but the `times`.
    """
    found: dict[tuple[str, str | None], JointColumn] = {}
    left: dict[str, list[str]] = defaultdict(list)
    for file, table in tables.items():
        unknown = [name for name in table.column_names if name != times[file].column]
        for name, (joint, by) in _joints_of(unknown, model).items():
            values = numbers_of(table[name])
            said = [word.rstrip("0123456789") for word in words_of(name)]
            kind = told_by(said, "robot") or (by == NAMED and "position")
            if values is None or not np.isfinite(values).any():
                reason = "no numbers"
            elif joint is None:
                reason = "no joint of the model in the name"
            elif not kind:
                reason = "no word in the name says what it is of a joint"
            elif (kind, joint) in found:
                reason = f"{found[kind, joint].guess.column} is taken"
            elif kind == "velocity":
                reason = "positions tell the rates"
            elif kind == "ctrl" and actuator_on(model, model.joint(joint).id) < 0:
                reason = "no motor of the model drives the joint"
            else:
                guess = Guess(name, values, reason=by)
                found[kind, joint] = JointColumn(file, kind, joint, guess)
                continue
            left[f"{file}: {reason}"].append(name)
    remarks = [f"not taken of {of}: {', '.join(names)}" for of, names in left.items()]
    moved = {joint for kind, joint in found if kind == "position"}
    if still := [name for name in _joints(model) if name not in moved]:
        remarks.append(f"no column is the position of {', '.join(still)}")
    return [*found.values()], remarks


def _joints(model: Any) -> list[str]:
    """Names of the joints of `model`, in its order."""
    return [model.joint(i).name for i in range(model.njnt)]


def _joints_of(columns: Sequence[str], model: Any) -> dict[str, tuple[str | None, str]]:
    """Joint of `model` of each of `columns`, None without any, and what tells it.

    That is the longest name of a joint, or of its motor, that stands in the column's,
    or the place among columns that differ in a number and are as many as the joints.
    """
    joints = _joints(model)
    owners = {name: name for name in joints}
    for joint in joints:
        if (motor := actuator_on(model, model.joint(joint).id)) >= 0:
            owners.setdefault(model.actuator(motor).name, joint)
    families: dict[str, list[str]] = defaultdict(list)
    found: dict[str, tuple[str | None, str]] = {}
    for column in columns:
        inside = f" {_told(column)} "
        if hits := [name for name in owners if f" {_told(name)} " in inside]:
            found[column] = owners[max(hits, key=len)], NAMED
        else:
            families[re.sub(r"\d+(?=\D*$)", "", column)].append(column)
    for family in families.values():
        if len(family) == len(joints) > 1:
            ordered = sorted(family, key=lambda name: (len(name), name))
            found |= {c: (j, PLACED) for c, j in zip(ordered, joints, strict=True)}
    return found | {c: (None, "") for c in columns if c not in found}


def _told(name: str) -> str:
    """Words and numbers in a name, without those that tell only a role."""
    parts = re.findall(r"[^\W\d_]+|\d+", name.lower())
    told = [part for part in parts if part not in ROLES]
    return " ".join(told if any(map(str.isalpha, told)) else parts)


def _name(column: JointColumn, mode: str, model: Any) -> str:
    """Name of the signal or the input that a `column` becomes."""
    given, _ = MODES[mode]
    if column.kind != given:
        return f"{column.joint}_{column.kind}"
    motor = actuator_on(model, model.joint(column.joint).id)
    return column.joint if given == "position" else str(model.actuator(motor).name)


def _with_unit(
    column: JointColumn,
    columns: Sequence[JointColumn],
    model: Any,
    servos: Mapping[str, Servo],
) -> JointColumn:
    """Copy of `column` with its unit: by a word of its name, the calibration of the
    robot's `servos`, or the range of all positions among `columns`.
    """
    guess, joint = column.guess, column.joint
    told = words_of(guess.column)
    if column.kind == "torque":
        return column.told(unit="N m", factor=None if SCALED & {*told} else 1.0)
    if model.joint(joint).type == mujoco.mjtJoint.mjJNT_SLIDE:
        return column.told(unit="m", reason=f"{guess.reason}, as the model has it")
    named = [unit for word in told if (unit := UNITS.get(word)) in ("deg", "rad")]
    largest = max(
        np.nanmax(np.abs(each.guess.values))
        for each in columns
        if each.kind in MODES["forward"]
    )
    if named:
        return column.told(unit=named[0])
    if servo := servos.get(joint):
        return _of_servo(column, servo, largest)
    unit = "deg" if largest > TURN else "rad"
    return column.told(unit=unit, reason=f"{guess.reason} and range")


def _of_servo(column: JointColumn, servo: Servo, largest: float) -> JointColumn:
    """Copy of `column` with the unit of a servo whose calibration by LeRobot says how
    far it turns: from -100 to 100, a gripper from 0.
    """
    if largest > 101.0:
        raise ConfigurationError(
            f"calibration: positions reach {largest:.0f}, of a range -100 to 100 is"
            " allowed; leave the calibration out, these are degrees"
        )
    turn = (servo.range_max - servo.range_min) / COUNTS
    parts = 100.0 if "gripper" in column.joint else 200.0
    return column.told(
        unit="deg", factor=round(turn / parts, 6), reason="its calibration"
    )


def _error(column: JointColumn) -> float:
    """Standard deviation [SI] of the values of `column`: of a torque by its size, of a
    position by what changes from one step to the next.
    """
    values = column.with_factor().guess.si()
    error = OF_TORQUE * float(np.nanstd(values))
    if column.kind != "torque":
        jerks = np.diff(values[np.isfinite(values)], 3)  # white noise times 20^0.5
        error = max(robust_sigma(jerks) / 20**0.5, QUIETEST)
    return float(f"{error:.2g}")


def _tried(draft: Draft, runs: Sequence[Source]) -> Draft:
    """Copy of `draft` with units, signs and sides of torques that the model's own tell
    along the motion of `runs`, and with remarks on what the check says of these.
    """
    try:
        subject = _opened(draft, runs)
    except ConfigurationError as error:
        remark = f"does not open: {error}"
        return replace(draft, remarks=(*draft.remarks, remark))
    known: dict[str, Any] = {}
    remarks = []
    for finding in subject.contradictions():
        if finding.mend and (len(runs) == 1 or not finding.run):
            known |= finding.mend
        else:
            remarks.append(str(finding))
    factors = (isinstance(subject, InverseDynamics) and subject.torque_factors()) or {}
    for name, factor in factors.items():
        guess = draft.columns[name].guess
        if guess.factor is None:
            size = 1.0 / abs(factor)
            reason = f"about {size:.2g} by the model's torques"
            known[name] = {"scale": size, "reversed": factor < 0.0, "reason": reason}
        elif name in known:
            known[name]["reason"] = f"{guess.reason} and the model's torques"
    return replace(draft.told(known), remarks=(*draft.remarks, *remarks))


def _opened(draft: Draft, runs: Sequence[Source]) -> MechanismSubject:
    """Drafted mechanism with its `runs`; ConfigurationError where they do not fit."""
    columns = {name: each.with_factor() for name, each in draft.columns.items()}
    whole = replace(draft, columns=columns)
    mapping = parse(parse_yaml(whole.mapping(), "draft"), SignalMapping, "draft")
    file = draft.model.with_name(f".{draft.name}-draft.yaml")  # beside its model
    write_file(file, whole.robot())
    try:
        with TemporaryDirectory() as scratch:
            folders = [RunFolder(Path(scratch) / run.name, run.name) for run in runs]
            for i, run in enumerate(runs):
                write_run(run, mapping, i, folders[i].path)
            return open_mechanism(file, folders)
    finally:
        file.unlink()
