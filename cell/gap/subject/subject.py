"""Interface between the gap engine and a measured subject, strip or mechanism."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from drivers.types import Array

Words = NDArray[np.str_]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of a model: where to start, its bounds, the step of its secants.

    `start` is the stated value, for an effect its null. `spread` is the standard deviation of
    what was known before (infinite: nothing). `inverse` parameters are shown as reciprocals,
    so that a null at infinity is a zero here. `shape` parameters say where or how an effect is,
    not how much of it there is: a probe keeps its own whatever its amount. `random` unknowns of
    a run are drawn anew in each run; their `spread` is estimated from the runs; `common` ones
    are expected to differ in any laboratory, unless the runs refute it. `tolerated` is the range
    that the file states for a value of the base; None where it states a `spread` alone.
    """

    name: str
    unit: str
    start: float
    low: float
    high: float
    step: float
    spread: float = float("inf")
    inverse: bool = False
    shape: bool = False
    random: bool = False
    common: bool = False
    tolerated: tuple[float, float] | None = None

    def stated_value(self, value: float) -> float:
        """`value` in the form that files state."""
        if not self.inverse:
            return value
        return 1.0 / value if value else float("inf")


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect that the model may lack, with its parameters and starts for the engine.

    `probes` are groups of whole parameter vectors at which it is screened, small to large; the
    members of a group may be mixed (one parameter each), groups may not (another place). Bounds
    that start at the null say that physics fixes the sign. `sentence` is for a technician.
    `model_error` is the fraction of the variance explained by this effect that may be its own
    modelling error: e^2 for a relative error e of its response. Shape parameters fit its law to a
    specimen: they stay at their start until it leaves more than noise.
    """

    name: str
    sentence: str
    of: Literal["strip", "cell", "model", "rig"]
    parameters: tuple[Parameter, ...]
    probes: tuple[tuple[tuple[float, ...], ...], ...]
    revealed_by: str = ""
    model_error: float = 0.02
    shape_parameters: tuple[Parameter, ...] = ()

    def with_shape(self) -> "Candidate":
        """The candidate with its shape parameters free."""
        whole = self.parameters + self.shape_parameters
        return replace(self, parameters=whole, shape_parameters=())

    def complete(self, values: Array) -> Array:
        """`values` (k,) of its first parameters, with the starts of the others."""
        return np.concatenate([values, self.null[len(values) :]])

    @property
    def null(self) -> Array:
        """Values (k,) at which the effect vanishes."""
        return np.array([p.start for p in self.parameters])


@dataclass(frozen=True, slots=True)
class Samples:
    """Layout of the n samples of a run, sorted by time within a series.

    Words (n,): `channel`, `phase`, `zone`, and `quantity`, by which gaps are shown. Numbers
    (n,): time `t` [s], one-sigma `noise` of the sample, `reading` of a single reading in it, and
    `floor`, what no model of this subject gets right, all in SI. `series` (n,) numbers the time
    series that a sample belongs to.
    """

    channel: Words
    phase: Words
    zone: Words
    quantity: Words
    t: Array
    noise: Array
    reading: Array
    floor: Array
    series: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True)
class Run:
    """One measured (or planned) run; `local` are its own unknowns, such as its initial state.

    `condition` is shared by repeats, `index` counts in the order in which runs were taken;
    `content` belongs to the subject. `common` are errors of measuring that are alike in all runs:
    by name, the residuals (n,) [SI] that one standard deviation of it makes.
    """

    name: str
    condition: str
    samples: Samples
    local: tuple[Parameter, ...] = ()
    content: object = None
    index: int = 0
    common: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Request:
    """One simulation: a run, base parameters, parameters by effect, and the run's own unknowns.

    A `rough` one serves to be held against other rough ones: a subject may simulate it faster.
    """

    run: Run
    base: Array
    effects: Mapping[str, Array]
    local: Array
    rough: bool = False


@dataclass(frozen=True, slots=True)
class Residuals:
    """Measured minus simulated per sample (n,), NaN where the model has nothing to compare.

    `square` (n,) is the mean square within the sample where it averages several readings.
    """

    mean: Array
    square: Array


@dataclass(frozen=True, slots=True)
class Quantity:
    """Presentation of a measured quantity's gap: key in the verdict, factor from SI, unit.

    Without a key it is fitted like any other, and its gap is part of the excess only.

    `tolerance` [SI] is the rms that may remain after an effect was named: what a model of this
    subject is not trusted below.
    """

    key: str
    factor: float
    unit: str
    tolerance: float = 0.0


@dataclass(frozen=True, slots=True)
class Experiment:
    """A run that could be made next: its instruction, its cost, and the predicted run."""

    name: str
    instruction: str
    minutes: float
    run: Run


@dataclass(frozen=True, slots=True)
class Scattering:
    """A quantity that differs from run to run, described in words, with its remedy."""

    name: str
    sentence: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Scope:
    """What a subject offers: base parameters, candidate effects, quantities by name.

    `terms` are never causes: they describe what stays unexplained. `scatter` names the random
    unknowns of runs. `left` is the share of the excess gap that several effects named together
    may leave: more, and they only imitate a cause outside the library. Where spreads of the base
    are `believed`, a base that fits by values far beyond them is doubted as one that leaves a gap.
    """

    base: tuple[Parameter, ...]
    candidates: tuple[Candidate, ...]
    quantities: Mapping[str, Quantity]
    terms: tuple[Candidate, ...] = ()
    scatter: tuple[Scattering, ...] = ()
    left: float = 0.5
    believed: bool = False


class Subject(Protocol):
    """The measured thing: its runs, its library, its simulation, its files."""

    @property
    def name(self) -> str:
        """Name of the strip or pendulum."""

    @property
    def runs(self) -> Sequence[Run]:
        """The measured runs, in the order in which they were taken."""

    @property
    def notes(self) -> Sequence[str]:
        """Remarks for the operator on the runs: which died, and which parts were used."""

    @property
    def scope(self) -> Scope:
        """Base parameters, candidates, quantities and terms."""

    def simulate(self, requests: Sequence[Request]) -> Sequence[Residuals]:
        """Residuals of many simulations, each independent of the others in the call."""

    def refine(self, requests: Sequence[Request]) -> Sequence[Run]:
        """The runs of `requests`, corrected for the coarseness of their simulation at these values,
        with floors that allow for it.
        """

    def experiments(self) -> Sequence[Experiment]:
        """Possible next runs, to be rated by how well they separate explanations."""

    def patch(
        self, base: Mapping[str, float], effects: Mapping[str, Mapping[str, float]], source: str
    ) -> tuple[dict[str, object], dict[str, object] | None]:
        """The file after acceptance, and the cell's effects where some belong to the cell."""


@runtime_checkable
class HasConsequences(Protocol):
    """A subject whose effects have consequences for the operator."""

    def consequences(
        self, base: Mapping[str, float], effects: Mapping[str, Mapping[str, float]]
    ) -> Sequence[str]:
        """Sentences for the operator on the consequences of named effects."""


@runtime_checkable
class EditsModel(Protocol):
    """A subject whose acceptance writes a model of its own beside the file."""

    def model_text(
        self, base: Mapping[str, float], effects: Mapping[str, Mapping[str, float]]
    ) -> str | None:
        """Text of the model after acceptance, where it has its own file; the patch names that under
        `model`.
        """
