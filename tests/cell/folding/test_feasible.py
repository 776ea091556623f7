"""What the cell cannot see, reach or fold is refused before anything moves, and says
why.
"""

import math
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import cell as python
from calibration.calibration import Calibration
from cell.base.config.cell import CellFile
from cell.base.config.length import metres
from cell.base.config.places import CHECKOUT_CONFIGS
from cell.folding.feasibility import assess, corner_strips, path_problems
from cell.folding.fold import fold
from drivers.base.errors import PreflightRefused
from drivers.base.installation import AxisLimits, MotionLimits, Mounting
from drivers.base.types import Array
from drivers.franka import checks
from drivers.franka.limits import FR3, PUBLISHED
from drivers.franka.model import arm_urdf
from tests.support.commands import invoke, run
from tests.support.requests import CELL, DENIM, request_for
from tests.support.twin_calibration import twin_calibration

ROBOT = "172.16.0.2"
NAMES = sorted(path.stem for path in (CHECKOUT_CONFIGS / "strips").glob("*.yaml"))


@pytest.fixture(scope="module")
def seen_by() -> Calibration:
    return twin_calibration(CELL.twin.camera)


def cell_with(**installation) -> CellFile:
    place = CELL.installation.model_copy(update=installation)
    return CELL.model_copy(update={"installation": place})


def robot(**fci) -> CellFile:
    """A cell with a robot as `fci` states it."""
    cell = CELL.with_drivers("fci")
    return cell.model_copy(update={"fci": cell.fci.model_copy(update=fci)})


def refusal(
    seen_by: Calibration, policy: str = "triangular", place=None, **changes
) -> str:
    """What is refused of a fold by the twin's arm, or by a robot in another `place`."""
    cell = cell_with(**(place or {})).with_drivers("twin" if place is None else "fci")
    asked = request_for("denim", policy, Path("runs"), cell=cell)
    strip = asked.strip.model_copy(update=changes)
    return "\n".join(assess(replace(asked, strip=strip), seen_by).problems)


@pytest.mark.parametrize("policy", ["triangular", "circular", "shifted", "feedback"])
def test_ordinary_strips_are_folded(seen_by, policy) -> None:
    assert refusal(seen_by, policy) == ""


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"width": 1.0}, "width: is 1000 mm"),
        ({"thickness": 0.02}, "thickness: is 20 mm"),
        (
            {"length": 2.0, "bending_length": 0.05, "place": {}},
            "workspace: the gripper would move from x.*from z = .*"
            "reach: the arm cannot follow",
        ),
        ({"length": 0.75}, "view: the camera does not see the strip at x = 0.75"),
        (
            {"length": 0.15},
            "length: a fold of 0.15 m rises to 0.07 m",
        ),
    ],
)
def test_what_the_cell_cannot_do_is_refused_with_its_reason(
    seen_by, changes, says
) -> None:
    assert re.search(says, refusal(seen_by, **changes), re.DOTALL)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (
            {"velocity": 0.05},
            "speed: the path at 0.1 m/s is over the arm's limits.*allowed at most 0.06.*"
            "lay_speed: 0.1 m/s is over the arm's limits, allowed at most 0.05",
        ),
        ({"acceleration": 0.01}, "allowed at most 0.0"),
        ({"jerk": 0.01}, "allowed at most 0.0"),
    ],
)
def test_path_over_the_arm_s_limits_is_refused_with_the_speed_that_fits(
    seen_by, tmp_path, changed, says
) -> None:
    limits = CELL.installation.limits
    slow = limits.x.model_copy(update=changed)
    cell = cell_with(limits=limits.model_copy(update={"x": slow, "z": slow}))
    asked = request_for("denim", "triangular", tmp_path, cell=cell)
    assert re.search(says, "\n".join(assess(asked, seen_by).problems), re.DOTALL)


def test_strip_that_falls_into_the_notch_is_refused_with_the_width_to_cut(
    seen_by, tmp_path
) -> None:
    asked = request_for("denim", "triangular", tmp_path, cell=robot(address=ROBOT))

    def told(width: float) -> str:
        strip = asked.strip.model_copy(update={"width": width})
        return "\n".join(assess(replace(asked, strip=strip), seen_by).problems)

    assert "cut it at least 42 mm wide" in told(0.03)
    assert "wide" not in told(0.043)


def test_dry_run_predicts_the_fold_at_the_speed_of_a_real_robot(
    seen_by, tmp_path
) -> None:
    asked = request_for("denim", "triangular", tmp_path, cell=robot(address=ROBOT))
    made = assess(asked, seen_by)
    assert made.expected[0] == made.prediction.displacement > -0.025  # else -0.033


def test_speeds_that_a_refusal_states_are_followed_on_the_path_of_that_speed() -> None:
    def path(speed: float) -> Array:
        # slower is steeper
        return np.array([(0.6, 0.0), (0.3, 0.8 - 5 * speed), (0.0, 0.0)])

    slow = AxisLimits(velocity=0.07, acceleration=4.0, jerk=100.0)
    cell, fast = cell_with(limits=MotionLimits(z=slow)).controller, path(0.1)
    said = "\n".join(path_problems(fast, fast, cell, path))
    stated = dict(
        re.findall(r"^(\w*speed): .* at most ([.0-9]+) m/s", said, re.MULTILINE)
    )
    fold = cell.fold.model_copy(
        update={name: float(speed) for name, speed in stated.items()}
    )
    slower, steep = cell.model_copy(update={"fold": fold}), path(fold.speed)
    assert [*path_problems(steep, steep, slower, path)] == []
    assert "workspace" in next(path_problems(math.nan * steep, steep, slower, path))


@pytest.mark.parametrize(("away", "refused"), [(0.44, False), (0.45, True)])
@pytest.mark.parametrize("turn", [0.0, -0.4])
def test_reach_is_that_of_the_joints_from_a_turned_base(
    seen_by, away, refused, turn
) -> None:
    """The strip lies crosswise in front of the robot, `away` from the axis of its
    base.
    """
    x, y = (
        away * math.cos(turn) + 0.3 * math.sin(turn),
        away * math.sin(turn) - 0.3 * math.cos(turn),
    )
    said = refusal(
        seen_by, place={"mounting": Mounting(x=x, y=y, yaw=math.pi / 2 + turn)}
    )
    assert said.startswith("reach: the arm cannot follow the fold: x 598 mm") == refused
    assert bool(said) == refused


@pytest.mark.parametrize(
    ("joint", "end", "narrowed"), [(6, "lower", 1.2), (4, "upper", -1.4)]
)
def test_joint_described_narrower_than_a_fold_needs_is_named_with_its_value(
    seen_by, tmp_path, joint: int, end: str, narrowed: float, monkeypatch
) -> None:
    stated = f'{end}="{getattr(FR3, end)[joint - 1]}"'
    description = arm_urdf().replace(stated, f'{end}="{narrowed}"')
    monkeypatch.setattr(checks, "read_description", lambda _: description)
    asked = request_for("denim", "triangular", tmp_path, cell=robot(address=ROBOT))
    said = "\n".join(assess(asked, seen_by).problems)
    assert re.search(
        rf"joint {joint} (comes within|would turn at) -?\d\.\d\d rad", said
    )


@pytest.mark.slow
@pytest.mark.parametrize("model", PUBLISHED)
@pytest.mark.parametrize("name", NAMES)
def test_each_published_arm_takes_each_strip_in_a_dry_run(
    seen_by, tmp_path, model: str, name: str
) -> None:
    asked = request_for(name, "planned", tmp_path, cell=robot(model=model))
    made = assess(asked, seen_by)
    assert made.problems == ()
    assert made.reach.limits is PUBLISHED[model]


def test_what_no_file_states_of_a_strip_is_uncertain_by_a_tenth_and_a_half() -> None:
    strip = DENIM.model_copy(update={"spread": {}})
    corners = [
        (each.bending_length, each.retardation_time) for each in corner_strips(strip)
    ]
    shares = np.divide(corners, (strip.bending_length, strip.retardation_time))
    assert sorted(shares.round(6).tolist()) == [
        [0.9, 0.5],
        [0.9, 1.5],
        [1.1, 0.5],
        [1.1, 1.5],
    ]


@pytest.mark.parametrize(
    ("desk", "says"), [(None, ""), (0.6, ""), (0.85, "mm into the desk at x ")]
)
def test_fold_whose_hand_would_meet_the_desk_is_refused(seen_by, desk, says) -> None:
    said = refusal(seen_by, place={"desk": desk})
    assert says in said
    assert bool(said) == bool(says)


@pytest.mark.parametrize(("arm", "refused"), [("fci", True), ("twin", False)])
def test_fold_asks_for_the_hand_of_its_arm(
    seen_by, tmp_path, monkeypatch, arm, refused
) -> None:
    cell = cell_with(desk=0.85).with_drivers(arm)
    request = request_for("denim", "triangular", tmp_path, cell=cell)
    monkeypatch.setattr("cell.folding.fold.check_camera", lambda *_: None)
    devices = SimpleNamespace(camera=SimpleNamespace(rate="opened"), close=lambda: None)
    monkeypatch.setattr(
        "cell.folding.fold.run_header", lambda *_: pytest.fail("got through")
    )
    with pytest.raises(PreflightRefused if refused else pytest.fail.Exception) as ended:
        fold(request, seen_by, devices=devices)
    assert ("into the desk" in str(ended.value)) == refused


LONG = ("720mm", "triangular", "view: the camera does not see the strip")
LOW = ("200mm", "triangular", "length: a fold of 0.2 m rises")
SHORT = ("300mm", "adaptive", "policy knows 0.45 to 0.75 m")
FAR = ("900mm", "feedback", "workspace: the gripper would move")


@pytest.mark.parametrize(
    ("length", "policy", "says"), [pytest.param(*LONG, marks=pytest.mark.slow), LOW]
)
def test_dry_run_rehearsal_fold_and_python_refuse_by_one_list_and_one_code(
    monkeypatch, capsys, tmp_path, length, policy, says
) -> None:
    strip = ("--strip", "unknown", "--length", length)
    words = ("fold", *strip, "--policy", policy, "--runs", tmp_path)
    told = []
    for way in (["--dry-run"], ["--rehearse"], []):
        assert run(monkeypatch, *words, *way) == 3
        told.append(capsys.readouterr().err.removeprefix("cell: ").strip())
    name = f"unknown:{metres('--length', length):g}"
    for door in (
        partial(python.predict, name, policy),
        partial(python.fold, name, policy),
    ):
        with pytest.raises(PreflightRefused) as refused:
            door()
        told.append(str(refused.value))
    assert says in told[0]
    assert set(told) == {told[0]}
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(("length", "policy", "says"), [SHORT, FAR])
def test_advice_of_a_refusal_is_not_refused_in_its_turn(
    monkeypatch, capsys, length, policy, says
) -> None:
    strip = ("--strip", "unknown", "--length", length)
    words = ["fold", "--dry-run", *strip, "--policy", policy]
    run(monkeypatch, *words)
    told = capsys.readouterr().err
    assert says in told
    advised = re.findall(r"allowed here is (--\S+ \S+?)[,:]", told)
    assert advised
    for advice in advised:
        option, value = advice.split()
        at = words.index(option)
        assert run(monkeypatch, *words[:at], option, value, *words[at + 2 :]) == 0


def test_stated_lengths_are_the_shortest_and_the_longest_that_are_folded(
    seen_by, tmp_path
) -> None:
    wide = {"COLUMNS": "300", "TERM": "dumb"}
    texts = [invoke("fold --help", env=wide).output]
    texts.append((CHECKOUT_CONFIGS.parent / "README.md").read_text("utf-8"))
    stated = {
        re.search(r"(0.\d\d) to (0.\d\d) m", re.sub(r"[^\w.]+", " ", text)).groups()
        for text in texts
    }
    shortest, longest = map(float, stated.pop())
    assert not stated
    allowed = []
    for length in (shortest - 0.01, shortest, longest, longest + 0.02):
        asked = request_for(f"unknown:{length:g}", "adaptive", tmp_path)
        allowed.append(not assess(asked, seen_by).problems)
    assert allowed == [False, True, True, False]
