"""Correction of a fold's aim by the learned bias, and the deviation measured in the
fold.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from cell.base.config.unmeasured_strip import UNKNOWN_NAME as UNKNOWN
from cell.folding.bias import LIMIT, Bias, bias
from cell.folding.experience import Experience, Memory
from cell.report.words import plural
from policies.policy import Policy

if TYPE_CHECKING:  # spares a refused request the compilation of perception
    from cell.orchestrator.outcome import Outcome

WEIGHTS_FOLDER = Path(__file__).parents[2] / "policies" / "weights"
TEACHING = {"layer_touch", "unlike_model"}  # outcomes of folds that were laid down
WORTH_SAYING = 5e-5  # m, half of the last digit that is printed


@runtime_checkable
class Correctable(Protocol):
    """Protocol of a policy that steers the gripper by a model of the strip, and so can
    aim at another displacement.
    """

    def correct(self, bias: float) -> None:
        """From the next `reset` on, aim at a displacement that compensates the `bias`
        [m], as the camera measures it.
        """


@dataclass(frozen=True, slots=True)
class BiasKey:
    """What a learned bias belongs to: the policy with its weights, the fabric, called
    `strip`, and the piece of it, called `specimen`.
    """

    policy: str
    strip: str
    specimen: str


@dataclass(frozen=True, slots=True)
class Correction:
    """Expected deviation [m] of a fold, as `seen` by the camera, by which its aim is
    corrected.

    `place` [m] is where the grasped edge is laid so that it ends at x = 0. `learned` is
    the source of the correction, None for a value that the user gave. A ruler measures
    laid edges but no touch, so that of the aim only what is seen is learned.
    """

    seen: float = 0.0
    learned: Bias | None = None
    place: float = 0.0

    def apply(self, policy: Policy) -> "Correction | None":
        """Correct the aim of `policy` and return this correction, or None where the
        policy has no model and so cannot be corrected.
        """
        if not isinstance(policy, Correctable):
            return None
        policy.correct(self.seen)
        return self

    def facts(self) -> dict[str, Any]:
        """Content of the entry `learning` in the header of a run: the lengths [m] of
        this correction, and what was learned.
        """
        return asdict(self)

    def sentence(self) -> str | None:
        """Text for the operator on what was corrected, in millimetres; None where
        nothing was.
        """
        learned = self.learned
        parts = []
        if abs(self.seen) >= WORTH_SAYING:
            parts.append(f"aimed {-1e3 * self.seen:+.1f} mm, the opposite of the bias")

        if abs(self.place) >= WORTH_SAYING:
            parts.append(
                f"laid the edge {-1e3 * self.place:+.1f} mm, the opposite of its offset"
            )

        if not parts:
            return None
        if learned is None:
            return f"{'; '.join(parts)} that was given"

        folds = plural(learned.folds, "fold")
        text = f"{'; '.join(parts)} learned from {folds} of this cell"
        if learned.since is None:
            return text

        return (
            f"{text}; since run {learned.since} something moved: check the calibration"
        )


def subject_of(
    policy: str, checkpoint: Path | None, strip: str, specimen: str | None
) -> BiasKey:
    """What the bias of a fold belongs to: the policy with a digest of its weights, the
    fabric `strip` and the piece `specimen` of it.

    Without a `specimen`, a fabric with a file counts as one; each fold of another
    fabric is another piece.
    """
    files = (
        checkpoint,
        *(WEIGHTS_FOLDER / f"{policy}{end}" for end in (".npz", ".json")),
    )
    weights = next(
        (path for path in files if path is not None and path.is_file()), None
    )
    if weights is not None:
        policy = f"{policy}@{hashlib.sha256(weights.read_bytes()).hexdigest()[:12]}"
    return BiasKey(policy, strip, specimen or ("" if strip == UNKNOWN else strip))


def learned_correction(memory: Memory, subject: BiasKey) -> Correction:
    """Correction, within its limit, from the folds that `memory` holds for the policy,
    strip and specimen of `subject`; ConfigurationError where it cannot be read.
    """
    mine = [one for one in memory.experiences() if one.policy == subject.policy]
    learned = bias(mine, subject.strip, subject.specimen)
    seen, place = np.clip([learned.seen, learned.laid], -LIMIT, LIMIT).tolist()
    return Correction(seen, learned, place)


def experience_of(
    run: str,
    subject: BiasKey,
    outcome: "Outcome",
    correction: Correction,
    key: str = "",
) -> Experience | None:
    """What a measured fold teaches, which is its deviation from the prediction; None
    for a fold from which nothing can be learned.

    `run` and `key` name the run, as in `Experience`. Unusable are folds without a touch
    or laid edges, stopped ones, and those predicted blind. A strip that is unlike the
    model teaches too: it comes out the same way again.
    """
    touch = outcome.touch
    predicted = outcome.predicted
    is_blind = predicted is not None and predicted.blind
    if touch is None or outcome.name not in TEACHING or is_blind:
        return None
    aimed_at = 0.0 if predicted is None else predicted.displacement
    uncorrected_aim = aimed_at - correction.seen
    edges = outcome.edge_offset
    if edges is not None:
        from cell.base.devices.fold_path import edge_target, taut_edge

        target = touch.goal + correction.place
        edges += edge_target(taut_edge(touch), target) - touch.goal
    return Experience(
        run=run,
        policy=subject.policy,
        strip=subject.strip,
        specimen=subject.specimen or run,
        kind="camera",
        displacement=touch.displacement - uncorrected_aim,
        edges=edges,
        key=key,
        aim=-correction.seen,
        place=-correction.place,
    )


def correction_of(facts: Mapping[str, Any] | None) -> Correction:
    """Correction that the entry `learning` in the header of a run states; one of zero
    where `facts` is None or not valid.
    """
    facts = facts or {}
    values = [facts.get(key, 0.0) for key in ("seen", "unseen", "place")]
    if not all(isinstance(value, int | float) for value in values):
        return Correction()
    seen, unseen, place = map(float, values)  # `unseen` of older runs, of a known error
    return Correction(seen + unseen, learned=None, place=place)
