"""Result of a fold, as one line for a program and as text for a person."""

from dataclasses import dataclass
from typing import Any, Self

from cell.config.unknown import NAME as UNKNOWN
from cell.folding.learned import LEARNED
from cell.orchestrator.outcome import StopReason
from drivers.errors import CellError

LINE = ["run", "strip", "policy", "seed", "outcome", "displacement", "displacement_true"]
LINE += ["layer_touch", "edge_offset", "edge_offset_true", "like_model"]
LINE += ["duration", "wall", "calibration", "exit_code"]
ROUNDED = {name: 6 for name in LINE if name.startswith(("displacement", "edge_offset"))}  # m
ROUNDED |= {"layer_touch": 4, "duration": 4, "wall": 2}  # s


@dataclass(frozen=True, slots=True)
class FoldResult:
    """Result of one fold. Lengths [m], times [s]; None where not available.

    `displacement` is as measured by the camera, `edge_offset` the offset between the laid edges
    with the sign of d; values named true come from the twin only. `predicted` is the policy's
    prediction as text, `like_model` whether the strip behaved like the model (None where nothing
    judged it), and `warning` says that it did not; `correction` says by how much the aim was
    corrected.
    """

    run: str
    strip: str
    policy: str
    seed: int
    outcome: str
    reason: str
    displacement: float | None
    displacement_true: float | None
    layer_touch: float | None
    edge_offset: float | None
    edge_offset_true: float | None
    duration: float
    wall: float
    calibration: str
    exit_code: int
    predicted: str | None = None
    warning: str | None = None
    like_model: bool | None = None
    correction: str | None = None

    @classmethod
    def refusal(cls, strip: str, policy: str, seed: int, error: CellError) -> Self:
        """A fold that did not begin: `error` is the reason, and nothing was recorded."""
        stopped = StopReason.by(error)
        return cls(
            run="",
            strip=strip,
            policy=policy,
            seed=seed,
            outcome=stopped.name,
            reason=stopped.reason,
            displacement=None,
            displacement_true=None,
            layer_touch=None,
            edge_offset=None,
            edge_offset_true=None,
            duration=0.0,
            wall=0.0,
            calibration="",
            exit_code=stopped.exit_code,
        )

    def line(self) -> dict[str, Any]:
        """The object that `cell fold --json` prints, with the keys of the contract only."""
        values = {name: getattr(self, name) for name in LINE}
        values |= {key: values[key] or None for key in ("run", "calibration")}
        for key, digits in ROUNDED.items():
            if values[key] is not None:
                values[key] = round(values[key], digits)
        return values

    def sentence(self) -> str:
        """What happened, for the operator."""
        if self.displacement is None:
            return f"{self.strip}: {self.outcome}: {self.reason}"
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
        if self.exit_code != 0 and self.reason != self.warning:
            text += f"\n  {self.reason}"
        return text
