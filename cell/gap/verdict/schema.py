"""Schema of verdict.json, as other programs read it (contract of `cell gap fit`)."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from cell.gap.diagnosis.lack_of_fit import Bin
from cell.gap.diagnosis.next_experiment import Recommendation
from cell.gap.subject.subject import NamedValues
from cell.report.words import plain
from drivers.base.errors import ConfigurationError
from drivers.base.readers import MEGABYTE, read_json
from drivers.base.settings import parse

LARGEST_VERDICT = 8 * MEGABYTE
NAME_FOLDER = "name the folder that `cell gap fit --out` wrote"
Kind = Literal["named", "ambiguous", "no_gap", "unexplained"]
StepKind = Literal[
    "accept",
    "accept_values",
    "accept_suspected",
    "accept_law",
    "advise",
    "look",
    "repeat",
    "fold",
    "none",
]
Values = tuple[Mapping[str, float], NamedValues]
"""Values of the base by name, and of effects by parameter."""


class VerdictPart(BaseModel):
    """Base of all parts of a verdict: frozen, filled by field name; unknown keys are
    ignored.
    """

    model_config = ConfigDict(frozen=True, populate_by_name=True)


class Interval(VerdictPart):
    """Estimate `value` with its unit and the ends of its 95 % interval, None where it
    is unbounded.
    """

    value: float
    low: float | None
    high: float | None
    # that of a value of the base is the file's, SI
    unit: str = Field("", exclude_if=lambda unit: unit == "")

    def __str__(self) -> str:
        """Text of the value with its unit, if it has one, and the ends of its interval,
        where `any` stands for an unbounded end.
        """
        ends = ("any" if end is None else f"{end:.4g}" for end in (self.low, self.high))
        return (
            f"{f'{self.value:.4g} {self.unit}'.removesuffix(' 1')}"
            f" ({' to '.join(ends)})"
        )


class Deviation(Interval):
    """Refitted base value outside the `tolerated` range, whose upper end is None for
    infinity.
    """

    parameter: str
    stated: float
    tolerated: tuple[float, float | None]


class NamedEffect(VerdictPart):
    """Effect that a patch adds, with the probability that all named effects are
    right.
    """

    name: str
    of: Literal["strip", "cell", "model", "rig"]
    parameters: dict[str, Interval]
    confidence: float


class Unexplained(VerdictPart):
    """Residual that no effect of the library accounts for; `law` describes it and is no
    cause.
    """

    description: str
    law: str
    stable: bool


class Gap(VerdictPart):
    """Residuals on held-out runs, rms by quantity, and the share of their excess
    removed.
    """

    before: dict[str, float]
    after: dict[str, float]
    floor: dict[str, float]
    shrink: float
    shrink_low: float
    shrink_high: float

    def sentence(self) -> str:
        """Sentence on how far residuals of held-out runs exceed their noise before and
        after effects were added, in units of that noise.

        It names the quantities that grow beyond their noise.
        """
        before = self.before
        after = self.after
        excess = before["excess"]
        if not excess:
            return "held-out runs show no gap with the refitted file"
        grown = [k for k, v in self.floor.items() if after[k] > max(v, before[k])]
        return (
            f"beyond noise, held-out runs lie {excess:.2g} sigma off"
            f" with the refitted file, {after['excess']:.2g} sigma with what was"
            " found" + (f"; but {', '.join(grown)} grow" if grown else "")
        )


class Untested(VerdictPart):
    """What the runs cannot show, and why."""

    what: str
    why: str

    def __str__(self) -> str:
        """Text of what the runs cannot show, with the reason in brackets."""
        return f"{self.what} ({self.why})"


class CandidateEntry(VerdictPart):
    """Candidate effect, or several joined by ` + `, with its gain [nats] over the
    base.
    """

    name: str
    elpd_gain: float
    se: float
    p: float
    invariance_p: None = None
    parameters: dict[str, Interval]


class ProbableSet(VerdictPart):
    """Set of effects, and the probability `p` that these and no others are present."""

    names: list[str]
    p: float


LogOdds = Annotated[
    float, BeforeValidator(lambda value: math.inf if value is None else value)
]


class VerdictEvidence(VerdictPart):
    """Evidence for or against an accepted effect: log-odds and gains [nats], residuals,
    strain.

    `log_odds` [nats] are the posterior's of the effect, or of its class, null in
    verdict.json where they are infinite; `gain` [nats] is how much better unseen runs
    are predicted, `worst` that of the run or quantity that gains least. `left` is the
    rms that no law accounts for in the middle of the runs, in units of noise and floor,
    over channels that weigh alike; `correlation` that of neighbours in time in it, in
    fitted or held-out runs, where it is larger. `strain` is the largest deviation of
    the base from what the file states, in prior standard deviations.
    """

    log_odds: LogOdds = math.inf
    gain: Annotated[float, Field(alias="ahead")] = 0.0
    worst: float = 0.0
    left: float
    correlation: float
    strain: float = 0.0

    @property
    def correlated(self) -> float:
        """Root mean square, in units of noise, of the part of the residuals that the
        model leaves and that resembles its neighbours in time.

        The correlation itself is high, too, where hardly anything is left.
        """
        return self.left * math.sqrt(max(self.correlation, 0.0))

    @property
    def loss(self) -> float:
        """How much worse [nats] the model predicts the run or quantity that it predicts
        worst than the model without effects; zero where it predicts all better.
        """
        return max(-self.worst, 0.0)


class Probable(VerdictEvidence):
    """Posterior over the fitted sets of effects, the most probable first, and deciding
    evidence.

    `law` is whether one is offered.
    """

    models: list[ProbableSet]
    inclusion: dict[str, float]
    law: bool = False


@dataclass(frozen=True, slots=True)
class Step:
    """What may be done after a fit: a `command` to type, empty where there is none.

    `words` say what the command does or, without one, what to do.
    """

    kind: StepKind
    command: str
    words: str

    @property
    def sentence(self) -> str:
        """Sentence on the step without a full stop: its command in backticks, if it has
        one, and what that does.
        """
        return f"`{self.command}` {self.words}" if self.command else self.words

    def __str__(self) -> str:
        """Text of two lines: the command of the step, if it has one, and below it what
        that does.
        """
        return "\n  ".join(filter(None, (self.command, self.words)))


class Verdict(VerdictPart):
    """Content of verdict.json: which effects are missing, how surely, and how residuals
    shrink.

    `suspected` are effects that were accepted and are not named. `next` is what to do
    now, `alternatives` what could be done in its place; `untested` is what these runs
    cannot show, where nothing is named.
    """

    schema_: Annotated[int, Field(alias="schema")] = 1
    verdict: Kind
    effects: list[NamedEffect]
    ambiguous: list[list[str]]
    unexplained: Unexplained | None
    base: dict[str, Interval]
    where: list[Bin]
    gap: Gap
    candidates: list[CandidateEntry]
    advice: list[Recommendation]
    detectable: dict[str, float]
    held_out: list[str]
    runtime: float
    simulations: int
    posterior: Probable | None = None
    notes: list[str] = Field(default_factory=list)
    deviates: list[Deviation] = Field(default_factory=list)
    suspected: list[NamedEffect] = Field(default_factory=list)
    next: Step | None = None
    alternatives: list[Step] = Field(default_factory=list)
    untested: list[Untested] = Field(default_factory=list)

    @property
    def steps(self) -> list[Step]:
        """All that may be done after the fit, with the advised step first."""
        return [*filter(None, [self.next]), *self.alternatives]

    @property
    def held_out_sentence(self) -> str:
        """Sentence on how well the model predicts runs that the fit has not seen.

        Where they show no gap, it says what else speaks for the name.
        """
        gap = self.gap
        sentence = gap.sentence()
        if gap.before["excess"] or not self.posterior:
            return sentence
        gained = f"{self.posterior.gain:.0f} nats"
        return (
            f"{sentence}; the fitted ones do, and left out in turn they are"
            f" predicted better by {gained}"
        )

    def values_with(self, effects: Sequence[NamedEffect]) -> Values:
        """Pair of fitted values for a patch: those of the file's own parameters by
        name, and those of each of `effects` by effect and parameter.
        """
        base = {name: v.value for name, v in self.base.items()}
        return base, {
            effect.name: {k: v.value for k, v in effect.parameters.items()}
            for effect in effects
        }

    def __str__(self) -> str:
        """Text of a few lines with the verdict, its effects in SI units, and how far
        the gap to measurements shrinks.
        """
        return "\n  ".join(self._lines())

    __repr__ = __str__

    def _lines(self) -> Iterator[str]:
        yield plain(self.verdict)
        for effect in self.effects:
            values = ", ".join(
                f"{name} {value}" for name, value in effect.parameters.items()
            )
            yield (
                f"{effect.name}: {values}; right with probability"
                f" {effect.confidence:.2f}"
            )

        for names in self.ambiguous:
            yield f"alike in these runs: {', '.join(names)}"

        if self.unexplained:
            yield f"unexplained: {self.unexplained.description}"
        if self.effects:
            beside = " and one of each that are alike" if self.ambiguous else ""
            yield f"{self.held_out_sentence}{beside}"
        if self.untested:
            yield f"not tested: {'; '.join(map(str, self.untested))}"

        for note in self.notes:
            yield f"note: {note}"

    def _repr_html_(self) -> str:
        """HTML for a notebook: what is missing, and bars of the residuals of held-out
        runs before and after.
        """
        gap = self.gap
        rows = "".join(
            f"<tr><td>{escape(plain(key))}</td>"
            f"{_meter(was, now)}{_meter(now, was)}"
            f"<td>{gap.floor.get(key, 0.0):.3g}</td></tr>"
            for key, was in gap.before.items()
            for now in (gap.after[key],)
        )
        head = "<tr><th>rms</th><th>before</th><th>after</th><th>noise</th></tr>"
        return f"<pre>{escape(str(self))}</pre><table>{head}{rows}</table>"

    def to_json(self) -> str:
        """Content of verdict.json as text, without those lists that are empty and that
        only some verdicts have.
        """
        at_times = ("deviates", "suspected", "alternatives", "untested")
        absent = {key for key in at_times if not getattr(self, key)}
        return self.model_dump_json(by_alias=True, indent=1, exclude=absent) + "\n"


def _meter(value: float, other: float) -> str:
    """HTML table cell with a number and a bar for `value`, to the same scale as that
    for the `other` value.
    """
    return (
        f'<td>{value:.3g} <meter max="{max(value, other)}"'
        f' value="{value}"></meter></td>'
    )


def read_verdict(path: Path) -> Verdict:
    """Verdict of a fit, read from the file at `path`; ConfigurationError where that is
    missing or broken.
    """
    fit_folder(path.parent)
    if not path.exists():
        raise ConfigurationError(f"{path}: is missing; {NAME_FOLDER}")
    return parse(read_json(path, LARGEST_VERDICT), Verdict, str(path))


def fit_folder(out: Path) -> Path:
    """The same folder `out` of a fit, checked; ConfigurationError where there is no
    such folder.
    """
    if not out.is_dir():
        what = "is a file" if out.exists() else "no such folder"
        raise ConfigurationError(f"{out}: {what}; {NAME_FOLDER}")
    return out
