"""Result of a fold, as one line for a program and as text for a person."""

from dataclasses import dataclass
from typing import Any, Self

from cell.config.unknown import UNKNOWN_NAME as UNKNOWN
from cell.folding.learned import LEARNED
from cell.orchestrator.outcome import StopReason
from drivers.errors import CellError

LINE_COLUMNS = ["run", "strip", "policy", "seed", "outcome", "displacement", "displacement_true"]
LINE_COLUMNS += ["layer_touch", "edge_offset", "edge_offset_true", "like_model"]
LINE_COLUMNS += ["duration", "wall", "calibration", "exit_code"]
# m
LINE_DIGITS = {name: 6 for name in LINE_COLUMNS if name.startswith(("displacement", "edge_offset"))}
LINE_DIGITS |= {"layer_touch": 4, "duration": 4, "wall": 2}  # s


@dataclass(frozen=True, slots=True)
class FoldResult:
    """Result of one fold: lengths [m], times [s]; None where not available.

    `displacement` is as measured by the camera, `edge_offset` the offset between the laid edges
    with the sign of d; values named true come from the twin only. `predicted` is the policy's
    prediction as text, `like_model` whether the strip behaved like the model (None where nothing
    judged it), and `warning` says that it did not, or what the preflight found; `correction` says
    by how much the aim was corrected.
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

    @classmethod
    def refusal(cls, strip: str, policy: str, seed: int, error: CellError) -> Self:
        """Result of a fold that did not begin: `error` is the reason, and nothing was recorded."""
        stopped = StopReason.by(error)
        return cls("", strip, policy, seed, stopped.name, stopped.reason, stopped.exit_code)

    def line(self) -> dict[str, Any]:
        """Object that `cell fold --json` prints, with the contract's keys only."""
        values = {name: getattr(self, name) for name in LINE_COLUMNS}
        values |= {key: values[key] or None for key in ("run", "calibration")}
        for key, digits in LINE_DIGITS.items():
            if values[key] is not None:
                values[key] = round(values[key], digits)
        return values

    def sentence(self) -> str:
        """Text of the result for the operator."""
        if self.displacement is None:
            warning = "" if self.warning is None else f"\n  {self.warning}"
            return f"{self.strip}: {self.outcome}: {self.reason}{warning}"
        folded = "folded" if self.exit_code == 0 else f"not folded ({self.outcome})"
        text = f"{self.strip}: {folded}, displacement {1e3 * self.displacement:+.1f} mm"
        if self.displacement_true is not None:
            text += f" (true {1e3 * self.displacement_true:+.1f} mm)"
        if self.edge_offset is not None:
            text += f"; laid down, the edges lie {1e3 * self.edge_offset:+.1f} mm apart"
        if self.edge_offset_true is not None:
            text += f" (true {1e3 * self.edge_offset_true:+.1f} mm)"
        if self.predicted is not None:
            text += f"\n  {self.predicted}"
            if self.strip == UNKNOWN:
                text += f"\n  strip file with what was learned: {self.run}/{LEARNED}"
        if self.correction is not None:
            text += f"\n  {self.correction}"
        if self.warning is not None:
            text += f"\n  {self.warning}"
        if self.exit_code != 0 and self.reason not in (self.warning or ""):
            text += f"\n  {self.reason}"
        return text
