"""Outcome of a run: its name, reason and exit code, and what was measured."""

from dataclasses import dataclass, replace
from typing import Self

from cell.orchestrator.operator import Interrupted
from cell.perception.length_checks import LengthCheck
from cell.perception.model_agreement import Agreement
from cell.perception.strip_measurement import SeenTouch
from drivers.base.errors import CellError, Fault, PreflightRefused
from policies.policy import FoldPrediction

NAMES = {PreflightRefused: "preflight_refused", Interrupted: "interrupted"}


@dataclass(frozen=True, slots=True)
class Outcome:
    """End of a run: its name, reason and exit code of the command line, and what was
    measured.

    `name` is layer_touch, path_done, calibrated or the name of a fault. Times are from
    the lift [s]; `touch` is the measured one, `edge_offset` the offset of the laid
    edges [m], `duration` the whole run on the cell's clock [s], `predicted` by the
    policy, `witnesses` what was compared of camera, arm and prediction, `agreement`
    whether the strip behaved like the model, where that was found out.
    """

    name: str
    reason: str
    exit_code: int
    touch: SeenTouch | None = None
    edge_offset: float | None = None
    duration: float = 0.0
    predicted: FoldPrediction | None = None
    witnesses: tuple[LengthCheck, ...] = ()
    agreement: Agreement | None = None

    @classmethod
    def from_error(cls, error: Exception) -> Self:
        """Outcome, without a measurement, for the exception `error`; an unexpected
        exception gives `internal_error`.
        """
        if isinstance(error, Fault):
            return cls(error.name, error.reason, error.exit_code)
        if isinstance(error, CellError):
            return cls(NAMES.get(type(error), "error"), str(error), error.exit_code)
        return cls(
            "internal_error", f"{type(error).__name__}: {error}", Fault.exit_code
        )

    def overridden_by(self, later: "Outcome") -> Self:
        """Copy of the outcome with name and reason of the failure `later`, and the
        higher of both exit codes.
        """
        if self.name == later.name:
            return self
        code = max(self.exit_code, later.exit_code)
        return replace(self, name=later.name, reason=later.reason, exit_code=code)


INTERRUPTED = Outcome("interrupted", "stopped by Ctrl-C or a signal", 130)
INTERRUPTED_AT_ONCE = Outcome(
    "interrupted", "stopped at once by Ctrl-C or a signal", 130
)
