"""Errors of measuring a strip: those that differ from run to run, and those that runs
share.
"""

from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cell.gap.subject.subject import Samples, ScatterSource
from drivers.base.readers import read_yaml
from drivers.base.settings import StudyResult
from drivers.base.types import Array, frozen
from drivers.strip.model import StripModel, with_field


@dataclass(frozen=True, slots=True, kw_only=True)
class RunEffect(ScatterSource):
    """Quantity of a strip or of the rig that differs from run to run, and the field of
    the strip's model that it changes.

    `place` is the part and field of the model to which its value is added, as a share
    of the field where the unit is 1.
    """

    place: str

    def apply(self, model: StripModel, value: float) -> StripModel:
        """Copy of `model` in which `value` is added to the field that this quantity
        changes, as a fraction of it where the unit is 1.
        """
        stated = attrgetter(self.place)(model)
        changed = frozen(stated * (1.0 + value)) if self.unit == "1" else stated + value
        return with_field(model, self.place, changed)


RUN_EFFECTS, FORCE_EFFECTS = (
    tuple(RunEffect(name=name, **stated) for name, stated in group.items())
    for group in read_yaml(Path(__file__).with_name("run_effects.yaml")).values()
)
"""What differs between runs, and between runs that measure force besides."""

KNOWN_EFFECTS = (*RUN_EFFECTS, *FORCE_EFFECTS)

SLACK_EFFECTS = tuple(effect for effect in RUN_EFFECTS if effect.name == "slack")
"""What is allowed for where no runs can say more: planned runs, and sizes of hidden
effects.
"""


class CameraBias(StudyResult):
    """Standard deviations [m, s] of perception's mean error over half a run, by
    quantity.

    Written by `python -m tests.lab study perception`. `edge` is how far out the near
    edge is seen, which moves the whole profile; the other errors are independent, that
    of the profile adds to it.
    """

    FILE = Path(__file__).with_name("bias.yaml")

    edge: float
    profile: float
    contact_x: float
    touch_time: float
    touch_x: float
    displacement: float
    strips: int


class ModelError(StudyResult):
    """Relative standard deviation of fitted `damping` between simulation engines.

    Written by `python -m tests.lab study damping`.
    """

    FILE = Path(__file__).with_name("damping.yaml")

    damping: float
    strips: int


def common_errors(samples: Samples, past: NDArray[np.bool_]) -> dict[str, Array]:
    """Residuals [m or s], one for each sample, that one standard deviation of each
    systematic measurement error causes, by the error's name.

    `past` (n,) says whether the gripper is past the middle of the strip: there a lifted
    strip shows its near edge on the other side.
    """
    sizes = CameraBias.shipped()
    quantities = samples.quantity
    sides = np.where(quantities == "profile", np.where(past, 1.0, -1.0), 0.0)
    errors = {"near edge": frozen(sizes.edge * sides)}

    # samples of one group err alike
    halves = np.where(past, "past", "before")
    zones = [f"{zone} {half}" for zone, half in zip(samples.zone, halves, strict=True)]
    one_group = np.full(len(halves), "")
    groups_of = {
        "profile": np.array(zones),
        "contact_x": halves,
        "touch_time": one_group,
        "touch_x": one_group,
        "displacement": one_group,
    }
    for quantity, groups in groups_of.items():
        measured = quantities == quantity
        size = getattr(sizes, quantity)
        for group in dict.fromkeys(map(str, groups[measured])):
            members = measured & (groups == group)
            errors[f"{quantity} {group}".strip()] = frozen(np.where(members, size, 0.0))

    return errors
