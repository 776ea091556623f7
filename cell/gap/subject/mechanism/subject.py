"""Mechanism as a subject of the gap engine: measured signals compared with predicted
ones.
"""

import copy
from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
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
from drivers.base.types import Array

BLOCK = 0.4  # rad of the fastest signal in one sample
# key, factor, and tolerated rms gap, of positions [rad, m] and rates; of torques a
# share of their spread, for they follow from current or duty, with ripple and supply
# that no model states; assumed
KINDS = {
    "position": ("mrad", 1e3, 1e-3),
    "velocity": ("mrads", 1e3, 1e-2),
    "torque": ("Nm", 1.0, 0.05),
    "tracking": ("mrad", 1e3, 1e-4),
    "site": ("mm", 1e3, 1e-3),
    "sensor": ("si", 1.0, 0.0),
}
HARDLY = 0.03  # rad or m, travel of a joint below which it hardly shows anything
# of keys, which write them without space or slash
UNITS = {"Nm": "N m", "mrads": "mrad/s"}


class Content(NamedTuple):
    """Readings of a run, and inputs of its prediction: `load`, `motion` or `commands`.

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
    """One prediction of a run's signals, with the base and the `known` effects of a
    request.

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
    """Measured runs of one `mechanism`.

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
        """Note that contacts are off; refuse models with parts that the mode would
        ignore.
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
        """Names of the parts of the model that signals in this mode would ignore."""
        return ()

    @abstractmethod
    def predict(self, cases: Sequence[Case]) -> Sequence[Array | None]:
        """Signals (signals, k) of each case at the k times of its readings, by
        simulation.

        None where its simulation diverges.
        """

    @abstractmethod
    def _content(self, recording: Recording, cut: Cut) -> Content:
        """Readings `cut` from a `recording`, with load, motion or commands."""

    def _scope_without(self, without: Sequence[str]) -> Scope:
        """Fit problem of the mechanism, without the candidates named in `without`."""
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
        """Display of a channel's residuals; torques have a tolerance by their
        spread.
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
        """Run for the engine: samples with their phases, and the run's own unknowns."""
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
        """Residuals of `requests`, measured minus simulated; NaN where a simulation
        diverges.
        """
        cases = [self._case(request) for request in requests]
        residuals = []
        for case, predicted in zip(cases, self.predict(cases), strict=True):
            cut = case.content.cut
            difference = cut.values - (np.nan if predicted is None else predicted)
            residuals.append(Residuals(*average(difference, cut.edges)))
        return residuals

    def _case(self, request: SimulationRequest) -> Case:
        """What to predict for a request: how to edit the model, the errors of reading,
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
        """Effects that the file states, then those of a `request`, with their
        values.
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
        """Drawings of simulated signals and their residuals; None where a simulation
        diverges.
        """
        cases = [self._case(request) for request in requests]
        return [
            None if rows is None else self._scene(case.content.cut, rows)
            for case, rows in zip(cases, self.predict(cases), strict=True)
        ]

    def _scene(self, cut: Cut, predicted: Array) -> Scene:
        """Drawing of `predicted` signals (signals, k), and of the residuals to measured
        ones.
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
        """Content of the refitted mechanism file; None for cell.yaml, which does not
        change.
        """
        return accepted_content(self.mechanism, base, effects, source), None

    def model_texts(
        self, base: Mapping[str, float], effects: NamedValues
    ) -> dict[str, str]:
        """MJCF texts of the model with refitted base and named effects: the `model` for
        this mode, the `plain` one with all effects that fields of a model can state.
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
        """Findings on recordings that stand still, wrap or touch, whatever is compared
        of them.
        """
        yield from contradictions(self.mechanism)

    def check(self, origin: str) -> None:
        """Refuse stated models that cannot be simulated."""
        if not np.isfinite(self._stated_residuals()).all():
            advice = "make step smaller, or mend masses, inertias and gains"
            wrong = (str(each) for each in self.contradictions() if each.level == "bad")
            raise ConfigurationError(
                f"{origin}: model: run {self.runs[0].name} cannot be simulated, its"
                f" motion explodes; {next(wrong, advice)}"
            )

    def _stated_residuals(self) -> Array:
        """Mean residuals (samples,) of the first run by the stated model."""
        return self.simulate([self.stated(self.runs[0])])[0].mean


def _known(mechanism: Mechanism, effects: NamedValues) -> Known:
    """Effects of `mechanism` by name, each with its values in the order of its
    parameters.
    """
    named = [(library()[name], values) for name, values in effects.items()]
    return [(each, ordered_values(each, mechanism, values)) for each, values in named]


def _edited(
    mechanism: Mechanism, load: Load | None, base: Array, effects: Known, model: Any
) -> Any:
    """Copy of a MuJoCo `model` that has the base (k,), the load of a run and the
    effects in its fields or laws.
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
