"""Result of a fold, as JSON for a program and as text for a person."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Self

from cell.base.config.unmeasured_strip import UNKNOWN_NAME as UNKNOWN
from cell.folding.documents import LEARNED
from cell.folding.request import Request
from cell.orchestrator.operator import Interrupted
from cell.orchestrator.outcome import Outcome
from cell.perception.length_checks import LengthCheck
from cell.record.header import LAID, NOT_FOLDED
from drivers.base.errors import CellError, in_mm

LENGTHS = ("displacement", "displacement_true", "edge_offset", "edge_offset_true")
LINE_DIGITS = {**dict.fromkeys(LENGTHS, 6), "layer_touch": 4, "duration": 4, "wall": 2}
LINE_COLUMNS = ("run", "strip", "policy", "seed", "outcome", *LENGTHS[:2],
                "layer_touch", *LENGTHS[2:], "like_model", "duration", "wall",
                "calibration", "exit_code", "witnesses")  # fmt: skip


@dataclass(frozen=True, slots=True)
class FoldResult:
    """Result of one fold, with lengths [m] and times [s]; a value is None where it is
    not available.

    `displacement` is as measured by the camera, `edge_offset` the offset between the
    laid edges with the sign of d; values named true come from the twin only.
    `predicted` is the policy's prediction as text, `like_model` whether the strip
    behaved like the model (None where nothing judged it), `witnesses` what was
    compared, and `warning` what of this disagrees, or what the preflight found;
    `correction` says by how much the aim was corrected. The strip is folded `folded_at`
    [m] from its grasped edge, in half where that is None.
    """

    run: str
    strip: str
    policy: str
    seed: int
    outcome: str
    reason: str
    exit_code: int
    displacement: float | None = None
    displacement_true: float | None = None
    layer_touch: float | None = None
    edge_offset: float | None = None
    edge_offset_true: float | None = None
    duration: float = 0.0
    wall: float = 0.0
    calibration: str = ""
    predicted: str | None = None
    warning: str | None = None
    like_model: bool | None = None
    correction: str | None = None
    witnesses: tuple[LengthCheck, ...] = ()
    folded_at: float | None = None

    @classmethod
    def refusal(cls, request: Request, error: CellError) -> Self:
        """Result of a fold that did not begin because of `error`; raises `error`
        instead where that is an interruption by the user.
        """
        if isinstance(error, Interrupted):
            raise error
        return cls.from_outcome(request, Outcome.from_error(error), {})

    @classmethod
    def from_outcome(
        cls, request: Request, outcome: Outcome, truth: Mapping[str, Any]
    ) -> Self:
        """Result of the fold of `request` from its `outcome` and the values `truth` of
        a simulated strip, without the folder of its run.
        """
        touch = outcome.touch
        return cls(
            run="",
            strip=request.strip.name,
            policy=request.policy,
            seed=request.trial.seed,
            outcome=outcome.name,
            reason=outcome.reason,
            displacement=None if touch is None else touch.displacement,
            displacement_true=truth.get("displacement"),
            layer_touch=None if touch is None else touch.time,
            edge_offset=outcome.edge_offset,
            edge_offset_true=truth.get("edge_offset"),
            duration=outcome.duration,
            exit_code=outcome.exit_code,
            predicted=None
            if outcome.predicted is None
            else outcome.predicted.sentence(),
            like_model=None
            if outcome.agreement is None
            else outcome.agreement.like_model,
            correction=request.learning.correction.sentence(),
            witnesses=outcome.witnesses,
            folded_at=None if request.line.is_half else request.line.at,
        )

    @property
    def offset(self) -> float:
        """Size [m] of the offset between the laid edges, of the displacement where that
        is not known, or infinity where neither is.
        """
        offset = self.displacement if self.edge_offset is None else self.edge_offset
        return inf if offset is None else abs(offset)

    def ends(self, until: float) -> bool:
        """Whether this fold ends a series: it was stopped, or it succeeded and left its
        edges within `until` [m] of each other.
        """
        return self.exit_code > 1 or (self.exit_code == 0 and self.offset <= until)

    @property
    def went_as_planned(self) -> bool:
        """Whether the run of a standard motion is complete enough to be
        used for a fit.

        A lift there and back ends without a touch, and how the strip lies afterwards is
        not compared with anything.
        """
        return self.outcome in NOT_FOLDED | {"layer_touch", "path_done"}

    def line(self) -> dict[str, Any]:
        """Content of the JSON object that `cell fold --json` prints on the result."""
        values = {name: getattr(self, name) for name in LINE_COLUMNS}
        values |= {key: values[key] or None for key in ("run", "calibration")}
        for key, digits in LINE_DIGITS.items():
            if values[key] is not None:
                values[key] = round(values[key], digits)
        values["witnesses"] = [witness.facts() for witness in self.witnesses]
        return values

    def __str__(self) -> str:
        """Text of the result for the operator, of one or more lines."""
        if self.displacement is None:
            lines = [f"{self.strip}: {self.outcome}: {self.reason}", self.warning]
            return "\n  ".join(filter(None, lines))
        folded = "folded"
        if self.exit_code != 0:
            is_laid = "" if self.outcome in LAID else "not "
            folded = f"{is_laid}folded ({self.outcome})"
        if self.folded_at is not None:
            folded += f" {in_mm(self.folded_at)} from its grasped edge"
        text = f"{self.strip}: {folded}, displacement {1e3 * self.displacement:+.1f} mm"
        if (d := self.displacement_true) is not None:
            text += f" (true {1e3 * d:+.1f} mm)"
        d, true = self.edge_offset, self.edge_offset_true
        if d is not None:
            lower = "the lower one" if self.folded_at is None else "its place"
            text += f"; laid down, the upper edge lies {_edge_words(d)} {lower}"
        elif true is not None:
            text += "; the edges are not seen"
        if true is not None:
            text += f" (true {_edge_words(true)})"
        lines = [text, self.predicted]
        if self.predicted is not None and self.strip == UNKNOWN:
            lines.append(f"strip file with what was learned: {self.run}/{LEARNED}")
        lines += [self.correction, self.warning]
        if self.exit_code != 0 and self.reason not in (self.warning or ""):
            lines.append(self.reason)
        return "\n  ".join(filter(None, lines))

    __repr__ = __str__


def _edge_words(offset: float) -> str:
    """Text on how far the laid edge of the upper layer lies beyond the lower one's or,
    where `offset` [m] is negative, before it.
    """
    return f"{in_mm(abs(offset), 1)} {'beyond' if offset > 0 else 'before'}"
