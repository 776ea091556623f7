"""Mechanism as a subject of the gap engine: measured signals compared with predicted
ones.
"""

import copy
from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cell.gap.subject.mechanism.contradictions import contradictions
from cell.gap.subject.mechanism.effect import Known, Readings, readings_of
from cell.gap.subject.mechanism.effects import (
    TERMS,
    accepted_parameters,
    candidates,
    library,
    ordered_values,
    torques,
)
from cell.gap.subject.mechanism.model import FORWARD, Mechanism, add_point
from cell.gap.subject.mechanism.patch import (
    FORMAT,
    NOT_SAID,
    accepted_content,
    accepted_xml,
    unsaid,
)
from cell.gap.subject.mechanism.read_mechanism import initial_state, stated_start
from cell.gap.subject.mechanism.recordings import (
    Cut,
    Recording,
    average,
    cut_recording,
    phases,
    samples,
)
from cell.gap.subject.subject import (
    Finding,
    FitRun,
    NamedValues,
    Quantity,
    Residuals,
    Scene,
    Scope,
    SimulationRequest,
    Subject,
    TimeSeries,
)
from cell.record.header import Load
from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_yaml
from drivers.base.types import Array

BLOCK = 0.4  # rad of the fastest signal in one sample
KINDS = read_yaml(Path(__file__).with_name("signal_kinds.yaml"))
"""Key, factor and tolerated rms gap of each kind of signal."""
HARDLY = 0.03  # rad or m, travel of a joint below which it hardly shows anything
# of keys, which write them without space or slash
UNITS = {"Nm": "N m", "mrads": "mrad/s"}


class Content(NamedTuple):
    """Readings of a run of a mechanism, in `cut`, and what its prediction needs: the
    load, and the measured motion or the commands.

    Phases are by the `speed` (k,) at its readings; `start` are positions and rates
    (joints,) where the run is simulated from them.
    """

    cut: Cut
    speed: Array
    load: Load | None = None
    motion: Any = None
    commands: Any = None
    start: tuple[Array, ...] = ()


class Case(NamedTuple):
    """One prediction to be made of a run's signals, with the parameters of the file and
    the effects that a request asks for.

    `edited` copies a MuJoCo model with the base and effects in its fields, `readings`
    are errors of sensors and commands, `start` positions and rates (joints,). Cases of
    equal `motion` move alike; their readings may differ.
    """

    content: Content
    edited: Callable[[Any], Any]
    readings: Readings
    known: Known
    start: tuple[Array, ...]
    motion: Hashable


class MechanismSubject(Subject):
    """Measured runs of one mechanism, as a fit compares them with a model.

    A subclass predicts the signals; at the end of its construction it sets `runs`.
    """

    def __init__(
        self, mechanism: Mechanism, jobs: int = 1, without: Sequence[str] = ()
    ) -> None:
        self.mechanism = mechanism
        self.name = mechanism.file.name
        self._jobs = jobs
        self.origin = mechanism.origin
        self._sensors = mechanism.compared("torque")
        self._check_honoured()
        resting = [joint.name for joint in mechanism.joints if joint.travel < HARDLY]
        why = f"it moves by less than {1e3 * HARDLY:g} mrad or mm"
        self.untested = (*self.untested, *((name, why) for name in resting))
        self._scatter = {
            i: b.scatter for i, b in enumerate(mechanism.base) if b.scatter
        }
        self.scope = self._scope_without(without)

    def _check_honoured(self) -> None:
        """Raise ConfigurationError where the model has parts that this mode of
        prediction would ignore, and note that contacts are off.
        """
        mechanism = self.mechanism
        model = mechanism.model
        colliding = (model.geom_contype > 0) & (model.geom_conaffinity > 0)
        if not model.npair and len(set(model.geom_bodyid[colliding])) > 1:
            self.untested = (("contacts", "they are off along the measured motion"),)
            self.notes = (
                *self.notes,
                "contacts are off: the model lists no pair of geoms",
            )
        for left_out in self.not_honoured():
            raise ConfigurationError(
                f"{mechanism.path}: model: {left_out}: would be left out in mode"
                f" {mechanism.mode.name}; take it out of the model, or compare in"
                " the other mode"
            )

    def not_honoured(self) -> Iterable[str]:
        """Names of the parts of the model that this mode of prediction would ignore."""
        return ()

    @abstractmethod
    def predict(self, cases: Sequence[Case]) -> Sequence[Array | None]:
        """Predicted signals of each of `cases`, as an array of shape (signals,
        readings); None where a simulation diverges.
        """

    @abstractmethod
    def _content(self, recording: Recording, cut: Cut) -> Content:
        """Readings `cut` from `recording`, together with the load, the measured motion
        or the commands that the prediction needs.
        """

    def _scope_without(self, without: Sequence[str]) -> Scope:
        """What a fit of the mechanism may change: parameters of its file, and candidate
        effects without those named in `without`.
        """
        mechanism = self.mechanism
        whole = Scope(
            base=(
                *(b.parameter for b in mechanism.base),
                *accepted_parameters(mechanism),
            ),
            candidates=candidates(mechanism),
            quantities={
                signal.channel: self._quantity(signal.channel, signal.kind)
                for signal in mechanism.signals
            },
            terms=tuple(t.candidate(mechanism) for t in TERMS if t.applies(mechanism)),
            scatter=tuple(self._scatter.values()),
            believed=mechanism.mode.shapes,
        )
        return whole.withhold(
            without, [candidate.name for candidate in whole.candidates]
        )

    def _quantity(self, channel: str, kind: str) -> Quantity:
        """How the residuals of a `channel` are shown; those of torques have a tolerance
        in proportion to the torques' spread.
        """
        key, factor, tolerance = KINDS[kind]
        if kind == "torque":
            spread = [
                np.nanstd(recording.columns[channel])
                for recording in self.mechanism.recordings
            ]
            tolerance *= np.sqrt(np.mean(np.square(spread)))
        return Quantity(
            key=f"{channel}_{key}",
            factor=factor,
            unit=UNITS.get(key, key),
            tolerance=tolerance,
        )

    def _run(self, recording: Recording) -> FitRun:
        """Run for a fit from a recording: samples with their phases, and the unknowns
        that belong to this run alone.
        """
        mechanism = self.mechanism
        signals = mechanism.signals
        names = [signal.name for signal in signals]
        cut = cut_recording(recording, names, BLOCK / mechanism.pace)
        content = self._content(recording, cut)
        if recording.sigma:
            signals = tuple(
                replace(signal, sigma=recording.sigma) for signal in signals
            )

        local = initial_state(mechanism, content.start) if content.start else ()
        local += tuple(source.parameter for source in self._scatter.values())
        speed, _ = average(content.speed[None], content.cut.edges)
        known = samples(signals, content.cut, phases(speed))
        order = recording.index or 0
        return FitRun(
            name=recording.name,
            condition=recording.condition,
            samples=known,
            local=local,
            content=content,
            index=order,
        )

    def simulate(self, requests: Sequence[SimulationRequest]) -> list[Residuals]:
        """Residuals for each of `requests`, measured minus simulated signals; NaN where
        a simulation diverges.
        """
        cases = [self._case(request) for request in requests]
        residuals = []
        for case, predicted in zip(cases, self.predict(cases), strict=True):
            cut = case.content.cut
            difference = cut.values - (np.nan if predicted is None else predicted)
            residuals.append(Residuals(*average(difference, cut.edges)))
        return residuals

    def _case(self, request: SimulationRequest) -> Case:
        """What to predict for a request: how to edit the model, the errors of sensors,
        and where the motion starts.
        """
        mechanism = self.mechanism
        run = request.run
        content: Content = run.content
        names = [p.name for p in run.local]
        unknowns = dict(zip(names, request.local, strict=True))

        base = np.array(request.base[: len(mechanism.base)])
        for i, source in self._scatter.items():  # a fit leaves some of them out
            base[i] += unknowns.get(source.name, 0.0)

        known = self._known_effects(request)
        moving = [
            (effect.name, values.tobytes())
            for effect, values in known
            if effect.moves(mechanism) and values.any()
        ]
        start = stated_start(mechanism, unknowns) or content.start
        numbers = [values.tobytes() for values in (base, *start)]
        return Case(
            content=content,
            edited=partial(_edited, mechanism, content.load, base, known),
            readings=readings_of(known),
            known=known,
            start=start,
            motion=(run.name, *moving, *numbers),
        )

    def _known_effects(self, request: SimulationRequest) -> Known:
        """Effects that the mechanism's file states, then those of `request`, each with
        its parameter values.
        """
        owners = np.array([p.name.partition(".")[0] for p in self.scope.base])
        stated = self.mechanism.file.effects
        accepted = {name: request.base[owners == name] for name in stated}
        every = {**accepted, **request.effects}
        return [(library()[name], values) for name, values in every.items()]

    def draw_measured(self, run: FitRun) -> Scene:
        """Drawing of the measured signals of `run`."""
        cut = run.content.cut
        rows = zip(self.mechanism.signals, cut.values, strict=True)
        return Scene(tuple(TimeSeries(s.label, cut.t, row) for s, row in rows))

    def draw_simulated(
        self, requests: Sequence[SimulationRequest]
    ) -> list[Scene | None]:
        """Drawings of the simulated signals and of their residuals, one for each
        request; None where the simulation diverges.
        """
        cases = [self._case(request) for request in requests]
        return [
            None if rows is None else self._scene(case.content.cut, rows)
            for case, rows in zip(cases, self.predict(cases), strict=True)
        ]

    def _scene(self, cut: Cut, predicted: Array) -> Scene:
        """Drawing of the `predicted` signals, a row for each, and of the measured ones
        minus these.
        """
        drawn = []
        rows = zip(self.mechanism.signals, predicted, cut.values, strict=True)
        for signal, row, measured in rows:
            quantity = self.scope.quantities[signal.channel]
            title = f"{signal.label}, measured - simulated [{quantity.unit}]"
            drawn.append(TimeSeries(signal.label, cut.t, row))
            drawn.append(TimeSeries(title, cut.t, quantity.factor * (measured - row)))
        return Scene(tuple(drawn))

    def patch(
        self, base: Mapping[str, float], effects: NamedValues, source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """Content of the mechanism's file with the fitted values and effects; the
        second result is None, as the cell file does not change.
        """
        return accepted_content(self.mechanism, base, effects, source), None

    def model_texts(
        self, base: Mapping[str, float], effects: NamedValues
    ) -> dict[str, str]:
        """MJCF texts of the model with the fitted values and effects, by name: the
        `model` for this mode of prediction, and the `plain` one for other programs.
        """
        mechanism = self.mechanism
        alone = replace(
            mechanism, file=mechanism.file.model_copy(update={"mode": FORWARD.name})
        )
        stated = np.array([base[b.parameter.name] for b in mechanism.base])
        rest = accepted_content(mechanism, base, effects, "")["effects"]
        whole = _known(alone, {**effects, **rest})
        missing = "; ".join(unsaid(alone, whole))
        remarks = {FORMAT: "mechanism, version 1", NOT_SAID: missing}
        edited = _edited(
            mechanism,
            load=None,
            base=stated,
            effects=_known(mechanism, effects),
            model=mechanism.model,
        )
        plain = _edited(
            alone, load=None, base=stated, effects=whole, model=mechanism.model
        )
        return {
            "model": accepted_xml(mechanism, edited),
            "plain": accepted_xml(mechanism, plain, remarks),
        }

    def contradictions(self) -> Iterator[Finding]:
        """Findings on recordings in which nothing moves, angles jump by whole turns, or
        parts of the model touch.
        """
        yield from contradictions(self.mechanism)

    def check(self, origin: str) -> None:
        """Raise ConfigurationError where the model cannot be simulated as
        it is stated.
        """
        if not np.isfinite(self._stated_residuals()).all():
            advice = "make step smaller, or mend masses, inertias and gains"
            wrong = (str(each) for each in self.contradictions() if each.level == "bad")
            raise ConfigurationError(
                f"{origin}: model: run {self.runs[0].name} cannot be simulated, its"
                f" motion explodes; {next(wrong, advice)}"
            )

    def _stated_residuals(self) -> Array:
        """Mean residuals of the samples of the first run, with the model as it is
        stated.
        """
        return self.simulate([self.stated(self.runs[0])])[0].mean


def _known(mechanism: Mechanism, effects: NamedValues) -> Known:
    """Effects in `effects`, by name, each with the array of its parameter values in the
    order of its parameters.
    """
    named = [(library()[name], values) for name, values in effects.items()]
    return [(each, ordered_values(each, mechanism, values)) for each, values in named]


def _edited(
    mechanism: Mechanism, load: Load | None, base: Array, effects: Known, model: Any
) -> Any:
    """Copy of a MuJoCo `model` with the values `base` of the file's parameters, with
    the load of a run, and with the effects.
    """
    edited = copy.copy(model)
    for b, value in zip(mechanism.base, base, strict=True):
        b.put(edited, value)

    if load:
        add_point(
            edited, load.mass, mechanism.model.body(load.body).id, np.array(load.com)
        )

    for effect, values in effects:
        if not values.any():
            continue
        if effect.law and not effect.by_fields(mechanism):
            at = torques().at[effect.name]
            table = effect.table(mechanism, values)
            edited.jnt_user[:, at : at + len(table)] = table.T
        elif effect.edit:
            effect.edit(mechanism, values, edited)
    return edited
