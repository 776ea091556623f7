"""What the cell cannot see, reach or fold is refused before anything moves, and says why."""

import pytest

from calibration.calibration import Calibration
from cell.config.places import find_configs
from cell.folding.feasible import check_feasible
from drivers.errors import PreflightRefused
from policies.registry import make_policy
from tests.support.twin_calibration import twin_calibration


@pytest.fixture(scope="module")
def seen_by() -> Calibration:
    return twin_calibration(find_configs(None).cell().twin.camera)


def refusal(seen_by: Calibration, policy: str = "triangular", **changes) -> str:
    configs = find_configs(None)
    settings = configs.cell()
    strip = configs.strip("denim").model_copy(update=changes)
    made = make_policy(policy)
    made.reset(strip, settings.fold.speed, 1)
    try:
        check_feasible(settings.controller, strip, made, seen_by)
    except PreflightRefused as refused:
        return str(refused)
    return ""


@pytest.mark.parametrize("policy", ["triangular", "circular", "shifted", "feedback"])
def test_ordinary_strips_are_folded(seen_by, policy) -> None:
    assert refusal(seen_by, policy) == ""


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"width": 1.0}, "width: is 1000 mm"),
        ({"thickness": 0.02}, "thickness: is 20 mm"),
        ({"length": 2.0, "bending_length": 0.05}, "workspace: the gripper would move from x"),
        ({"length": 2.0, "bending_length": 0.05}, "from z = "),
        ({"length": 2.0, "bending_length": 0.05}, "reach: the gripper would be"),
        ({"length": 0.75}, "view: the camera does not see the strip at x = 0.75"),
        ({"length": 0.15}, "length: a fold of 0.15 m rises to 0.07 m"),
    ],
)
def test_what_the_cell_cannot_do_is_refused_with_its_reason(seen_by, changes, says) -> None:
    assert says in refusal(seen_by, **changes)
