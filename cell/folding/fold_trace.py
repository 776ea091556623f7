"""Trace of a fold, gripper path and strip profiles, to compare the strip with its
model.
"""

from dataclasses import asdict, replace

import numpy as np

from cell.orchestrator.outcome import Outcome
from cell.orchestrator.recorder import Recorder
from cell.orchestrator.snapshot import Snapshot
from cell.orchestrator.states import State
from cell.orchestrator.vision import MEASURED_STATES
from cell.perception.model_agreement import Agreement, MeasuredFold, agreement
from drivers.base.errors import CellError
from drivers.strip.file import StripFile
from policies.profile import image_profile

UNLIKE_REASON = "unlike_model"


class FoldTrace:
    """Observer of a fold that stores the gripper's path and the measured shapes of the
    strip, to compare the strip with its model at the end.
    """

    def __init__(self, strip: StripFile) -> None:
        """Begin the trace of a fold of `strip`, which is the strip as the controller
        knows it.
        """
        self._strip = strip
        self._path: list[tuple[float, ...]] = []
        self._stamps: list[float] = []
        self._profiles: list[np.ndarray] = []

    def handle_tick(self, snapshot: Snapshot) -> None:
        """Store the gripper's pose in `snapshot`, and the measured shape of the strip
        where it is a new one.
        """
        if snapshot.state not in MEASURED_STATES:
            return
        pose = snapshot.arm.pose
        seen = snapshot.view.measurement
        self._path.append((snapshot.arm.stamp, *pose.as_array()))
        if snapshot.state is State.FOLD and snapshot.view.read and seen is not None:
            self._stamps.append(seen.stamp)
            self._profiles.append(
                image_profile(seen.profile, seen.contact_x, seen.gripper)[0]
            )

    def handle_event(self, time: float, kind: str, facts: dict[str, object]) -> None:
        """Ignore an event of the run, as the trace needs none."""

    def review(self, outcome: Outcome, record: Recorder) -> Outcome:
        """Copy of `outcome` with how well the strip agrees with its model; where it
        behaves unlike it, a successful outcome becomes a failed one.
        """
        agreed = self._agreement(outcome, record.origin)
        outcome = replace(outcome, agreement=agreed)
        if agreed is None or agreed.like_model:
            return outcome
        reason = agreed.sentence()
        record.event(self._path[-1][0], UNLIKE_REASON, **asdict(agreed), reason=reason)
        if outcome.exit_code != 0:
            return outcome
        return outcome.overridden_by(Outcome(UNLIKE_REASON, reason, exit_code=1))

    def _agreement(self, outcome: Outcome, origin: float) -> Agreement | None:
        """How well the measured strip agrees with its model; None where there is no
        prediction, no touch of the layers, or no fit.
        """
        if outcome.predicted is None or outcome.touch is None or not self._stamps:
            return None

        touch = outcome.touch.time + origin
        path = np.array(self._path)
        stamps = np.array(self._stamps)
        curves = np.array(self._profiles)
        fold = MeasuredFold.until(touch, path[:, 0], path[:, 1:], stamps, curves)

        try:
            return agreement(self._strip, outcome.predicted, fold)
        except CellError:
            return None
