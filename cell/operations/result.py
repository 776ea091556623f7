"""What a fold leaves: one line for a program, one for a person."""

from dataclasses import dataclass
from typing import Any, Self

from cell.orchestrator.outcome import StopReason
from drivers.errors import CellError

LINE = ["run", "strip", "policy", "seed", "outcome", "displacement", "displacement_true"]
LINE += ["layer_touch", "duration", "wall", "calibration", "exit_code"]
ROUNDED = {"displacement": 6, "displacement_true": 6}  # m
ROUNDED |= {"layer_touch": 4, "duration": 4, "wall": 2}  # s


@dataclass(frozen=True, slots=True)
class FoldResult:
    """One fold. Lengths [m], times [s]; `displacement` as the camera saw it, `edge_offset` how far
    the edges lie apart once laid, with the sign of d; those called true come from the twin alone.
    None where there is none. `foretold` is what the policy expected, in words.
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
    foretold: str | None = None

    @classmethod
    def refused(cls, strip: str, policy: str, seed: int, error: CellError) -> Self:
        """A fold that did not begin: `error` says why, and nothing was recorded."""
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
        """The object that `cell fold --json` prints: the keys that programs agreed on, no more."""
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
        text = f"{self.strip}: folded, displacement {1e3 * self.displacement:+.1f} mm"
        if self.displacement_true is not None:
            text += f" (true {1e3 * self.displacement_true:+.1f} mm)"
        if self.edge_offset is not None:
            text += f"; laid down, the edges lie {1e3 * self.edge_offset:+.1f} mm apart"
        if self.edge_offset_true is not None:
            text += f" (true {1e3 * self.edge_offset_true:+.1f} mm)"
        if self.foretold is not None:
            text += f"\n  {self.foretold}"
        return text if self.exit_code == 0 else f"{text}; {self.outcome}: {self.reason}"
