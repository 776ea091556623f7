"""Interface of subjects, strips and mechanisms, to the gap engine: their runs and
simulation.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from shlex import quote
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivers.base.errors import ConfigurationError
from drivers.base.readers import file_digest
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter

Words = NDArray[np.str_]
NamedValues = Mapping[str, Mapping[str, float]]
"""Values by effect and parameter."""
FARTHEST = 8.0  # times its usual spread, the bound of a quantity in any run
Level = Literal["bad", "fair", "good"]


def note_of(
    key: str, old: float | None, source: str, remark: str = ""
) -> dict[str, str]:
    """Entry of a file's provenance for the changed `key`, which keeps its `old`
    value.
    """
    was = "was absent" if old is None else f"was {old:.9g}"
    return {"key": key, "source": source, "note": was + remark}


class Finding(BaseModel):
    """Problem of recordings, of a `level`: `bad` ones forbid a fit, `fair` ones cost
    accuracy.

    `run` is the name of a run, empty where the finding concerns all of them; `what` is
    the check, `words` say what is seen where, `remedy` what to do, if anything. `mend`
    says the same to a program: keys of a mapping or a mechanism's file by signal.
    """

    model_config = ConfigDict(frozen=True)

    level: Level = "fair"
    what: str
    run: str = ""
    words: str
    remedy: str
    mend: Mapping[str, Mapping[str, Any]] = Field(default_factory=dict, exclude=True)

    def __str__(self) -> str:
        """Line on the finding: run, check, what is seen, and the remedy."""
        where = f"{self.run or 'all runs'}: {self.what}: {self.words}"
        return f"{where}; {self.remedy}".removesuffix("; ")


def bad(what: str, words: str, remedy: str, **more: Any) -> Finding:
    """Finding on all runs that forbids a fit; `more` are further fields of it."""
    return Finding(what=what, words=words, remedy=remedy, level="bad", **more)


@dataclass(frozen=True, slots=True)
class Candidate:
    """Effect that a model may lack: its parameters, and the values at which it is
    screened.

    `probes` are groups of whole parameter vectors at which it is screened, small to
    large; the members of a group may be mixed (one parameter each), groups may not
    (another place). Bounds that start at the null say that physics fixes the sign.
    `sentence` is for a technician. `model_error` is the relative error of its response,
    that of its law. Shape parameters fit the law to a specimen: they stay at their
    start until it leaves more than noise. `usual` is how far its amount, the first
    parameter, lies from its null at most, as a rule; None where nobody knows.
    """

    name: str
    sentence: str
    of: Literal["strip", "cell", "model", "rig"]
    parameters: tuple[Parameter, ...]
    probes: tuple[tuple[tuple[float, ...], ...], ...]
    revealed_by: str = ""
    model_error: float = 0.02
    shape_parameters: tuple[Parameter, ...] = ()
    usual: float | None = None

    def is_usual(self, stated: float) -> bool:
        """Whether an amount, as files state it, is within what is usual."""
        amount = self.parameters[0]
        apart = abs(amount.stated_value(stated) - amount.start)
        return self.usual is None or apart <= self.usual

    def with_shape(self) -> "Candidate":
        """Copy of the effect whose shape parameters are fitted along with the
        others.
        """
        whole = self.parameters + self.shape_parameters
        return replace(self, parameters=whole, shape_parameters=())

    def complete(self, values: Array) -> Array:
        """Parameter vector (n,): `values` (k,) for the first ones, start values for the
        others.
        """
        return np.concatenate([values, self.null[len(values) :]])

    @property
    def null(self) -> Array:
        """Parameter values (k,) at which the effect vanishes."""
        return starts(self.parameters)

    def is_own(self, values: Array) -> bool:
        """Whether most shapes among parameter `values` (k,) are this effect's, not
        another's.
        """
        pairs = zip(self.parameters, values, strict=True)
        below = [value < p.own_from for p, value in pairs if np.isfinite(p.own_from)]
        return not below or 2 * sum(below) < len(below)

    @property
    def two_sided(self) -> bool:
        """Whether the effect's amount, its first parameter, may lie on either side of
        its null.
        """
        amount = self.parameters[0]
        return amount.low < amount.start < amount.high


def starts(parameters: Iterable[Parameter]) -> Array:
    """Start values (k,) of `parameters`."""
    return np.array([p.start for p in parameters])


class Series(NamedTuple):
    """Samples of one time series: fields as of `Samples`, each with an entry per
    sample, or one value for all of them.
    """

    channel: Words | str
    quantity: Words | str
    phase: Words | str
    zone: Words | str
    t: Array
    noise: Array | float
    reading: Array | float
    floor: Array | float


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples (n,) of a run, averages of readings: channel, zone, time [s], noise,
    floor.

    Words (n,): `channel`, `phase`, `zone`, and `quantity`, by which gaps are shown.
    Numbers (n,): time `t` [s], one-sigma `noise` of the sample, `reading` of a single
    reading in it, and `floor`, the error that every model of this subject has, all in
    SI. `series` (n,) numbers the time series that a sample belongs to.
    """

    channel: Words
    quantity: Words
    phase: Words
    zone: Words
    t: Array
    noise: Array
    reading: Array
    floor: Array
    series: NDArray[np.int64]

    @classmethod
    def stack(cls, series: Sequence[Series]) -> "Samples":
        """Samples of several time `series` one after another."""
        whole = [np.broadcast_arrays(*each) for each in series]
        stacked = [np.concatenate(rows) for rows in zip(*whole, strict=True)]
        counts = [len(each.t) for each in series]
        columns = dict(zip(Series._fields, stacked, strict=True))
        return cls(**columns, series=np.repeat(np.arange(len(series)), counts))

    @property
    def scale(self) -> Array:
        """Standard deviation (n,) of each sample: noise and floor in quadrature."""
        return np.hypot(self.noise, self.floor)

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True)
class FitRun:
    """Measured or planned run: its samples, and its unknowns `local`, such as its
    initial state.

    `condition` is shared by repeats, `index` counts in the order in which runs were
    taken; `content` belongs to the subject. `common` are errors of measuring that are
    alike in all runs: by name, the residuals (n,) [SI] that one standard deviation of
    it makes. A `replicate` repeats the motion of another run, along which its responses
    may be simulated.
    """

    name: str
    condition: str
    samples: Samples
    local: Sequence[Parameter] = ()
    content: Any = None
    index: int = 0
    common: Mapping[str, Array] = field(default_factory=dict)
    replicate: bool = False


@dataclass(frozen=True, slots=True)
class SimulationRequest:
    """Inputs of one simulation: run, base values, effect values, and the run's own
    unknowns.

    One of a `response` is compared with other such ones only: for all repeats of a
    motion, a subject may simulate one.
    """

    run: FitRun
    base: Array
    effects: Mapping[str, Array]
    local: Array
    response: bool = False


class Residuals(NamedTuple):
    """Measured minus simulated `mean` (n,) of each sample [SI], NaN where nothing is
    simulated.

    `square` (n,) is the mean square within the sample where it averages several
    readings.
    """

    mean: Array
    square: Array


class Quantity(NamedTuple):
    """Display of a measured quantity's residuals: verdict key, factor from SI, unit.

    Without a key it is fitted like any other, and its gap is part of the excess only.

    `tolerance` [SI] is the rms that is not held against a named effect: what a model of
    this subject is not trusted below.
    """

    key: str
    factor: float
    unit: str
    tolerance: float = 0.0


class Experiment(NamedTuple):
    """Run that could be made next, with an instruction for the operator and its
    duration [min].
    """

    name: str
    instruction: str
    minutes: float
    run: FitRun


@dataclass(frozen=True, slots=True)
class ScatterSource:
    """Quantity that differs from run to run, with its `usual` standard deviation in a
    laboratory.

    `sentence` names it for a technician, `remedy` is what makes it smaller. `step` is
    the change of its finite differences; a `common` quantity is expected to differ in
    any laboratory.
    """

    name: str
    sentence: str
    remedy: str
    unit: str
    usual: float
    step: float
    common: bool = False

    @property
    def parameter(self) -> Parameter:
        """Random unknown of a run for this quantity, with the `usual` spread as its
        prior.
        """
        usual = self.usual
        most = FARTHEST * usual
        return Parameter(
            name=self.name,
            unit=self.unit,
            start=0.0,
            low=-most,
            high=most,
            step=self.step,
            spread=usual,
            random=True,
            common=self.common,
        )


@dataclass(frozen=True, slots=True)
class Scope:
    """Fit problem of a subject: base parameters, candidate effects, and displayed
    quantities.

    `terms` are never causes: they describe what stays unexplained. `scatter` names the
    random unknowns of runs. Where spreads of the base are `believed`, a base that fits
    by values far beyond them is doubted as one that leaves a gap. `withheld` are the
    names of effects that were taken out of the library.
    """

    base: tuple[Parameter, ...]
    candidates: tuple[Candidate, ...]
    quantities: Mapping[str, Quantity]
    terms: tuple[Candidate, ...] = ()
    scatter: tuple[ScatterSource, ...] = ()
    believed: bool = False
    withheld: tuple[str, ...] = ()

    @property
    def by_name(self) -> Mapping[str, Candidate]:
        """Candidate effects by name."""
        return {candidate.name: candidate for candidate in self.candidates}

    def withhold(self, names: Sequence[str], known: Collection[str]) -> "Scope":
        """Copy without the candidate effects `names`, all of which must be `known`
        effects.

        Raises ConfigurationError for another name, and where no candidate would be
        left.
        """
        for name in names:
            if name not in known:
                allowed = ", ".join(sorted(known))
                raise ConfigurationError(
                    f"without {name}: is no effect; allowed: {allowed}"
                )
        kept = tuple(
            candidate for candidate in self.candidates if candidate.name not in names
        )
        if names and not kept:
            raise ConfigurationError(
                "every effect is withheld; leave at least one in the library"
            )
        return replace(self, candidates=kept, withheld=tuple(names))


class Curve(NamedTuple):
    """Moving curve: at each of the times `t` (m,) [s] its `points` (k, 2) in x and z
    [m].
    """

    t: Array
    points: tuple[Array, ...]


class Track(NamedTuple):
    """Moving point: its positions `places` (m, 2) in x and z [m] at the times `t` (m,)
    [s].
    """

    t: Array
    places: Array


class TimeSeries(NamedTuple):
    """Time series to plot: `values` (m,) at times `t` (m,) [s]; equal titles share a
    plot.
    """

    title: str
    t: Array
    values: Array


@dataclass(frozen=True, slots=True)
class Scene:
    """Drawing of a measured or simulated run: signals, a curve, tracks and events.

    `tracks` are given by name, `events` as (time [s], label).
    """

    signals: tuple[TimeSeries, ...]
    curve: Curve | None = None
    tracks: Mapping[str, Track] = field(default_factory=dict)
    events: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Origin:
    """File that states a subject: the `option` that names it on the command line.

    `digests` are the SHA-256, by path, of it and of all files that belong to it, each
    as it was before it was read.
    """

    option: str = "--model FILE"
    digests: Mapping[Path, str] = field(default_factory=dict)

    @classmethod
    def before_reading(cls, file: Path, option: str) -> Self:
        """Origin of a subject whose `file` is read next, named by the `option`."""
        return cls(f"{option} {quote(str(file))}", {file.resolve(): file_digest(file)})

    def changed(self) -> Path | None:
        """First file that is no longer as it was read; None without any."""
        for path, digest in self.digests.items():
            if not path.is_file() or file_digest(path) != digest:
                return path
        return None


NO_FILE = Origin()
"""Origin of a subject that no file states."""


class Subject(ABC):
    """Measured strip or mechanism: its runs, library of effects, simulation and files.

    `name` is its own, `runs` are in the order in which they were taken, `notes` are
    remarks for the operator on them, `untested` what they cannot show, and why. `scope`
    holds base parameters, candidate effects, quantities and descriptive terms. `origin`
    is the file that states it; probabilities of verdicts are calibrated on subjects of
    the same `kind`.
    """

    name: str
    kind: Literal["strip", "mechanism"] = "mechanism"
    runs: Sequence[FitRun]
    scope: Scope
    notes: Sequence[str] = ()
    untested: Sequence[tuple[str, str]] = ()
    origin: Origin = NO_FILE

    @abstractmethod
    def simulate(self, requests: Sequence[SimulationRequest]) -> Sequence[Residuals]:
        """Residuals of each of `requests`, simulated independently of the others."""

    def contradictions(self) -> Iterator[Finding]:
        """Findings on recordings that contradict the stated model, before any fit."""
        return iter(())

    @abstractmethod
    def patch(
        self, base: Mapping[str, float], effects: NamedValues, source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """Patched content of the subject's file, and of the cell's where effects belong
        to it.
        """

    def stated(
        self, run: FitRun, effects: Mapping[str, Array] | None = None
    ) -> SimulationRequest:
        """Request to simulate `run` at stated values, with `effects` (k,) by name."""
        return SimulationRequest(
            run=run,
            base=starts(self.scope.base),
            effects=effects or {},
            local=starts(run.local),
        )

    def refine(self, requests: Sequence[SimulationRequest]) -> Sequence[FitRun]:
        """Runs of `requests` with residuals corrected for coarse simulation, and error
        floors.
        """
        return [request.run for request in requests]

    def experiments(self) -> Sequence[Experiment]:
        """Runs that could be made next, simulated for the stated subject."""
        return ()

    def consequences(
        self,
        base: Mapping[str, float],  # noqa: ARG002
        effects: NamedValues,  # noqa: ARG002
    ) -> Sequence[str]:
        """Sentences for the operator on what the named effects change."""
        return ()

    def model_texts(
        self,
        base: Mapping[str, float],  # noqa: ARG002
        effects: NamedValues,  # noqa: ARG002
    ) -> dict[str, str]:
        """Texts of a model file with these `base` values and `effects`: of a `model`
        for this program, of a `plain` one for others; none without such a file.
        """
        return {}

    def draw_measured(self, run: FitRun) -> Scene:  # noqa: ARG002
        """Drawing of the measured `run`."""
        return Scene(())

    def draw_simulated(
        self, requests: Sequence[SimulationRequest]
    ) -> Sequence[Scene | None]:
        """Drawings of the simulations `requests`; None where a simulation has no
        motion.
        """
        return [None] * len(requests)
