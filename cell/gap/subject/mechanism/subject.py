"""Mechanism as a subject of the gap workflow: measured runs compared with simulated ones."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from cell.gap.subject.mechanism.effect import Effect, readings_of
from cell.gap.subject.mechanism.effects import (
    accepted_parameters,
    candidates,
    describing_terms,
    effect_of,
    group_by_effect,
    ordered_values,
    torques,
)
from cell.gap.subject.mechanism.engine import Case, Content, Engine
from cell.gap.subject.mechanism.fields import Fields, add_point
from cell.gap.subject.mechanism.forward import Forward
from cell.gap.subject.mechanism.load import MechanismData, initial_state, open_all, stated_fields
from cell.gap.subject.mechanism.patch import (
    accepted_xml,
    cell_patch,
    gripper_sentences,
    gripper_shift,
    patch_file,
)
from cell.gap.subject.mechanism.pendulum import open_swings
from cell.gap.subject.mechanism.prescribed import Prescribed
from cell.gap.subject.mechanism.runs import Cut, Recording, average
from cell.gap.subject.run_folders import RunFolder
from cell.gap.subject.scene import Scene
from cell.gap.subject.scene import Signal as Drawn
from cell.gap.subject.subject import (
    Candidate,
    NamedValues,
    Parameter,
    Quantity,
    Request,
    Residuals,
    Run,
    ScatterSource,
    Scope,
    Subject,
)
from cell.record.header import Load
from drivers.errors import ConfigurationError
from drivers.readers import read_yaml
from drivers.types import Array

ENGINES: Mapping[str, type[Forward | Prescribed]] = {
    "forward": Forward, "prescribed": Prescribed, "planar": Forward,
}  # fmt: skip
"""Engine by the mode of a mechanism."""
# rms gap that is tolerated, of positions [rad, m] and rates; of torques a share of their spread,
# for they follow from current or duty, with ripple and supply that no model states; assumed
TOLERANCE = {"position": 1e-3, "velocity": 1e-2, "torque": 0.05, "tracking": 1e-4, "site": 1e-3,
             "sensor": 0.0}  # fmt: skip
KEYS = {"position": ("mrad", 1e3), "tracking": ("mrad", 1e3), "velocity": ("mrads", 1e3),
        "torque": ("Nm", 1.0), "site": ("mm", 1e3), "sensor": ("si", 1.0)}  # fmt: skip
UNITS = {"Nm": "N m", "mrads": "mrad/s"}  # of keys, which write them without space or slash
# gears of which a side may be confused, and the factor within which their ratio is recognised
GEARED, TWICE = 3.0, 2.0
TINY = 1e-30  # against division by zero
THIRD = 1.0 / 3.0  # of its noise, by which halving the time step may move a signal


class MechanismSubject(Subject):
    """Measured runs of one mechanism, and their simulation by MuJoCo."""

    def __init__(self, opened: MechanismData, jobs: int = 1, without: Sequence[str] = ()) -> None:
        self.opened, self.name = opened, opened.file.name
        self._mechanism = opened.mechanism
        engine = ENGINES[opened.mechanism.mode]
        self._engine: Engine = engine(opened, jobs, self._compiled_effects())
        self.notes = self._engine.notes
        self.scope = self._scope_without(without)
        self._by_run = [(i, f"{b.parameter.name}_run") for i, b in enumerate(opened.base)
                        if b.by_run is not None]  # fmt: skip
        self.runs = tuple(self._run(r) for r in opened.recordings)

    def _compiled_effects(self) -> frozenset[str]:
        """Effects and terms whose laws a simulation must add to MuJoCo's own forces."""
        m = self._mechanism
        known = [effect_of(c.name) for c in (*self._candidates(), *describing_terms(m))]
        known += [effect_of(name) for name in self.opened.file.effects]
        return frozenset(e.name for e in known if e.law is not None and not e.edits(m))

    def _scope_without(self, without: Sequence[str]) -> Scope:
        """Fit problem of the mechanism, without the candidates named in `without`."""
        accepted, m = self.opened.file.effects, self._mechanism
        base = [b.parameter for b in self.opened.base]
        base += list(accepted_parameters(m, accepted))
        candidates = self._candidates()
        unknown = next((n for n in without if n not in {c.name for c in candidates}), None)
        if unknown is not None:
            raise ConfigurationError(f"--without {unknown}: no effect that these runs could show")
        quantities = {s.channel: self._quantity(s.channel, s.kind) for s in self.opened.signals}
        scatter = [ScatterSource(f"{b.parameter.name}_run", f"{b.field} of {b.owner}",
                              f"keep the {b.field} of {b.owner} steady")
                   for b in self.opened.base if b.by_run]  # fmt: skip
        return Scope(tuple(base), tuple(c for c in candidates if c.name not in without),
                     quantities, describing_terms(m), tuple(scatter),
                     believed=self.opened.pendulum is None)  # fmt: skip

    def _candidates(self) -> tuple[Candidate, ...]:
        stated = stated_fields(self.opened.base, self._mechanism)
        return candidates(self._mechanism, self.opened.file.effects, stated)

    def _quantity(self, channel: str, kind: str) -> Quantity:
        key, factor = KEYS[kind]
        tolerance = TOLERANCE[kind]
        if kind == "torque":
            spread = [np.nanstd(r.columns[channel]) for r in self.opened.recordings]
            tolerance *= float(np.sqrt(np.mean(np.square(spread))))
        return Quantity(f"{channel}_{key}", factor, UNITS.get(key, key), tolerance)

    def _run(self, recording: Recording) -> Run:
        """Run for the engine: samples with their phases, and the run's own unknowns."""
        o = self.opened
        content, known = self._engine.prepare(recording)
        local = () if content.start is None else initial_state(o, content.start)
        local += tuple(
            Parameter(name, o.base[i].parameter.unit, 0.0, -np.inf, np.inf,
                      step=o.base[i].parameter.step, spread=o.base[i].by_run or 0.0, random=True,
                      common=True) for i, name in self._by_run
        )  # fmt: skip
        return Run(recording.name, recording.condition, known, local, content, recording.index)

    def simulate(self, requests: Sequence[Request]) -> list[Residuals]:
        """Residuals of `requests`, measured minus simulated; NaN where a simulation is lost."""
        found = self._engine.predict([self._case(r) for r in requests])
        residuals = []
        for request, predicted in zip(requests, found, strict=True):
            made = _content_of(request.run).cut
            difference = made.values - (np.nan if predicted is None else predicted)
            residuals.append(Residuals(*average(difference, made.edges)))
        return residuals

    def _case(self, request: Request) -> Case:
        """Simulation that a request asks for."""
        content, count = _content_of(request.run), len(self.opened.base)
        names = [p.name for p in self.scope.base[count:]]
        effects = {**group_by_effect(names, request.base[count:]), **request.effects}
        known = [(effect_of(name), values) for name, values in effects.items()]
        own = dict(zip((p.name for p in request.run.local), request.local, strict=True))
        base = np.array(request.base[:count])
        for i, name in self._by_run:  # the engine leaves some of them out
            base[i] += own.get(name, 0.0)
        start = self._start(request, own)
        readings = readings_of(known, self._mechanism)
        paths = [(effect, values) for effect, values in known if effect.path is not None]
        edit = partial(self._edit, content.load, base, known)
        # all that a motion depends on; errors of reading it come later
        moving = [(e.name, v.tobytes()) for e, v in known if e.read is None and v.any()]
        numbers = [x if x is None else x.tobytes()
                   for x in (base, *start, readings.elastic, readings.gap)]  # fmt: skip
        motion = (request.run.name, readings.command, *moving, *numbers)
        return Case(content, edit, readings, paths, start, motion)

    def _start(self, request: Request, own: Mapping[str, float]) -> tuple[Array, Array]:
        """Start positions and rates (joints,): unknowns of the run, as measured, or zeros."""
        joints, start = self._mechanism.joints, _content_of(request.run).start
        n = len(joints)
        if start is None:
            return np.zeros(n), np.zeros(n)
        if f"angle_{joints[0].name}" in own:  # then `initial_state` made the first unknowns
            return request.local[:n], request.local[n : 2 * n]
        return start

    def _edit(self, load: Load | None, base: Array,
              effects: Sequence[tuple[Effect, Array]], fields: Fields) -> None:  # fmt: skip
        """Put values (k,) of the base, the run's load and effects into the fields of a model."""
        for b, value in zip(self.opened.base, base, strict=True):
            b.put(fields, float(value))
        if load is not None:
            body = self._mechanism.model.body(load.body).id
            add_point(fields, body, load.mass, np.array(load.com))
        for effect, values in effects:
            self._apply_effect(effect, values, fields)

    def _apply_effect(self, effect: Effect, values: Array, fields: Fields) -> None:
        """Edit the fields by an effect, or write the values (k,) of its compiled law to them."""
        if not values.any():
            return
        m = self._mechanism
        if effect.edit is not None and (effect.law is None or effect.edits(m)):
            effect.edit(m, values, fields)
        elif effect.law is not None:
            at, table = torques().at[effect.name], effect.table(m, values)
            fields["jnt_user"][: table.shape[1], at : at + len(table)] = table.T

    def draw_measured(self, run: Run) -> Scene:
        """Drawing of the measured signals of a run."""
        made = _content_of(run).cut
        rows = zip(self.opened.signals, made.values, strict=True)
        return Scene(tuple(Drawn(s.label, made.t, row) for s, row in rows))

    def draw_simulated(self, requests: Sequence[Request]) -> list[Scene | None]:
        """Drawings of simulated signals and residuals; None where a simulation is lost."""
        predicted = self._engine.predict([self._case(r) for r in requests])
        return [None if rows is None else self._scene(_content_of(request.run).cut, rows)
                for request, rows in zip(requests, predicted, strict=True)]  # fmt: skip

    def _scene(self, made: Cut, predicted: Array) -> Scene:
        """Drawing of `predicted` signals (signals, k), and of the residuals to measured ones."""
        drawn = []
        for signal, row, measured in zip(self.opened.signals, predicted, made.values, strict=True):
            quantity = self.scope.quantities[signal.channel]
            title = f"{signal.label}, measured - simulated [{quantity.unit}]"
            drawn.append(Drawn(signal.label, made.t, row))
            drawn.append(Drawn(title, made.t, quantity.factor * (measured - row)))
        return Scene(tuple(drawn))

    def patch(
        self, base: Mapping[str, float], effects: NamedValues, source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """Content of the file with refitted base and named effects, and the patch of the cell's."""
        of_cell = cell_patch(self.opened, base, effects) if self.opened.file.cell else None
        return patch_file(self.opened, base, effects, source), of_cell

    def consequences(self, base: Mapping[str, float], effects: NamedValues) -> Sequence[str]:
        """Sentences on how named effects move the cell's gripper, and where to accept them."""
        if not self.opened.file.cell:
            return ()
        words = list[str]()
        for name, values in effects.items():
            ordered = ordered_values(effect_of(name), self._mechanism, values)
            shifts = [self._shift(run, name, ordered, base) for run in self.runs]
            words += gripper_sentences(name, np.concatenate(shifts))
        return words

    def _shift(self, run: Run, name: str, values: Array, base: Mapping[str, float]) -> Array:
        """Distances (k,) [m] by which the effect `name` alone moves the gripper along a run."""
        about = np.array([base.get(p.name, p.start) for p in self.scope.base])
        own = np.array([p.start for p in run.local])
        cases = [self._case(Request(run, about, e, own)) for e in ({name: values}, {})]
        with_effect, without = self._engine.predict(cases)
        content = _content_of(run)
        if with_effect is None or without is None:
            return np.zeros(0)
        q = np.array([np.interp(content.cut.t, content.motion.t, x) for x in content.motion.q.T])
        changed = with_effect - without
        readings = readings_of([(effect_of(name), values)], self._mechanism)
        n = len(self._mechanism.torques)  # trackings follow torques
        return gripper_shift(self.opened, q.T, (changed[:n], changed[n:]), readings)

    def model_text(self, base: Mapping[str, float], effects: NamedValues) -> str | None:
        """MJCF text of the accepted model, to lie beside the stated one; None for a pendulum."""
        if self.opened.pendulum is not None:
            return None
        return accepted_xml(self.opened, base, effects)


def _content_of(run: Run) -> Content:
    return cast(Content, run.content)


def open_mechanism(
    path: Path, folders: Sequence[RunFolder], jobs: int = 1, without: Sequence[str] = ()
) -> MechanismSubject:
    """Read a mechanism's file and measured runs, and check them; effects `without` are withheld.

    Raises ConfigurationError for bad input, and where the stated model itself cannot be simulated.
    """
    if read_yaml(path).get("kind") == "pendulum":  # steps by its fastest swing, whatever its values
        return MechanismSubject(open_swings(path, folders), jobs, without)
    subject = MechanismSubject(open_all(path, folders), jobs, without)
    check_simulates(subject, str(path))
    return subject


def check_simulates(subject: MechanismSubject, origin: str) -> None:
    """Refuse a model whose simulation diverges, or depends on the step of its integrator.

    Raises ConfigurationError.
    """
    run, scope = subject.runs[0], subject.scope
    own = np.array([p.start for p in run.local])
    asked = [Request(run, np.array([p.start for p in scope.base]), {}, own)]
    (residuals,) = subject.simulate(asked)
    if not np.isfinite(residuals.mean).all():
        raise ConfigurationError(
            f"{origin}: model: run {run.name} cannot be simulated, its motion explodes; "
            "make step smaller, or mend masses, inertias and gains"
        )
    _check_sides(subject, residuals.mean, origin)
    m = subject.opened.mechanism
    if m.mode != "forward":
        return
    model = copy.copy(m.model)
    model.opt.timestep = 0.5 * m.step
    halved = replace(m, step=0.5 * m.step, model=model)
    first = replace(subject.opened, mechanism=halved, recordings=subject.opened.recordings[:1])
    (halved_residuals,) = MechanismSubject(first).simulate(asked)
    change = float(np.nanmax(np.abs(residuals.mean - halved_residuals.mean) / run.samples.reading))
    if change > THIRD:
        raise ConfigurationError(
            f"{origin}: step: half of it moves run {run.name} by {change:.2g} of its noise, at "
            f"most {THIRD:.2f} is allowed; make it smaller"
        )


def _check_sides(subject: MechanismSubject, residuals: Array, origin: str) -> None:
    """Refuse torques that are the stated model's once the other side of its gear is read.

    `residuals` (samples,) are those of the first run.
    """
    made, gears = _content_of(subject.runs[0]).cut, subject.opened.mechanism.model.actuator_gear
    measured = average(made.values, made.edges)[0]
    channel = subject.runs[0].samples.channel
    for sensor in subject.opened.mechanism.torques:
        rows = channel == sensor.name
        predicted = measured[rows] - residuals[rows]
        ratio = measured[rows] @ predicted / (predicted @ predicted + TINY)
        gear = float(gears[sensor.actuator, 0])
        side, other = ("motor", gear) if sensor.gear == gear else ("joint", 1.0 / gear)
        if abs(np.log(abs(other))) > np.log(GEARED) and 1.0 / TWICE < ratio / other < TWICE:
            right = "joint" if side == "motor" else "motor"
            raise ConfigurationError(
                f"{origin}: signals.{sensor.name}: reads {ratio:.3g} times the model's torque at "
                f"the {side}, about its gear of {gear:g}: it is read at the other side; state "
                f"side: {right}"
            )
