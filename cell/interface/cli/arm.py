"""Commands on the arm apart from folds: `cell home`, `park`, `jog`, `open` and
`register`.
"""

import sys
from functools import partial
from math import radians
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from cell.base.config.places import find_configs
from cell.interface.cli.options import (
    Arm,
    Configs,
    FullSpeed,
    ask,
    check_names,
    length_option,
)
from drivers.base.errors import ConfigurationError, in_percent

if TYPE_CHECKING:
    from collections.abc import Callable

    from cell.base.config.cell import CellFile
    from cell.base.devices.devices import Trial
    from cell.orchestrator.snapshot import Snapshot
    from cell.orchestrator.steps import Motion
    from drivers.franka.joint_requests import GoTo

Strip = Annotated[str, typer.Option(help="Strip that lies, or will lie, on the desk.")]
Recover = Annotated[
    bool, typer.Option("--recover", help="Ask the robot to leave its reflex first.")
]


def home(
    strip: Strip = "denim",
    arm: Arm = None,
    recover: Recover = False,
    reset_tool: Annotated[
        bool,
        typer.Option(
            "--reset-tool",
            help="Give the robot the Franka Hand without load as its tool.",
        ),
    ] = False,
    full_speed: FullSpeed = False,
    configs: Configs = None,
) -> None:
    """Move the gripper over the strip's edge, into the arm posture that can follow a
    fold.
    """
    found = find_configs(configs)
    check_names(found, strip)
    from cell.setup.arm import manual_motion
    from drivers.franka.joint_requests import GoTo

    settings, trial = _agree_to_motion(found.cell(), arm, full_speed, recover=recover)
    lying = found.strip(strip)
    done = "the arm is home"
    if settings.robot_address is None:
        _move(settings, trial, manual_motion.to_home(settings, lying), done)
    joints = manual_motion.home_joints(settings, lying)
    share = _share(full_speed=full_speed)
    request = GoTo(list(joints), share, recover=recover, reset_tool=reset_tool)
    _go_to(request, settings, "home", done)


def park(
    arm: Arm = None,
    recover: Recover = False,
    full_speed: FullSpeed = False,
    configs: Configs = None,
) -> None:
    """Move the robot upright, out of the way; the cell's own twin moves to its home
    instead.
    """
    from cell.base.devices.open import NO_STRIP
    from cell.setup.arm import manual_motion
    from drivers.franka.joint_requests import GoTo
    from drivers.franka.kinematics import HOME

    stated = find_configs(configs).cell()
    settings, trial = _agree_to_motion(stated, arm, full_speed, recover=recover)
    done = "the arm is parked"
    if settings.robot_address is None:
        _move(settings, trial, manual_motion.to_home(settings, NO_STRIP), done)
    request = GoTo(HOME.tolist(), _share(full_speed=full_speed), recover=recover)
    _go_to(request, settings, "to park", done)


def jog(
    x: Annotated[
        float, length_option("--x", "Along the strip, as 20mm [mm].", "mm")
    ] = 0.0,
    z: Annotated[float, length_option("--z", "Up, as 20mm [mm].", "mm")] = 0.0,
    pitch: Annotated[float, typer.Option(help="Turn [deg].")] = 0.0,
    arm: Arm = None,
    full_speed: FullSpeed = False,
    configs: Configs = None,
) -> None:
    """Move the gripper a little from its present pose: along the strip, up, or in
    pitch.
    """
    if not (x or z or pitch):
        raise ConfigurationError("--x, --z, --pitch: give one at least, as --z 20mm")
    from cell.setup.arm import manual_motion

    settings, trial = _agree_to_motion(find_configs(configs).cell(), arm, full_speed)
    _move(settings, trial, manual_motion.jog(x, z, radians(pitch)))


def open_hand(arm: Arm = None, configs: Configs = None) -> None:
    """Open the fingers of the hand."""
    from cell.orchestrator import steps

    settings, trial = _agree_to_motion(
        find_configs(configs).cell(), arm, full_speed=False
    )
    _move(settings, trial, lambda _: steps.open_hand(), "the fingers are open")


def register(strip: Strip = "denim", configs: Configs = None) -> None:
    """Locate desk and fixed edge for the robot: touch three points with its closed
    fingers.
    """
    found = find_configs(configs)
    check_names(found, strip)
    import numpy as np

    from cell.setup.arm.manual_motion import robot_task
    from cell.setup.arm.register import (
        TOUCH_POINTS,
        mounting_from_points,
        touched_point,
        write_mounting,
    )

    robot = robot_task(found.cell())
    length = found.strip(strip).length
    from drivers.franka.joint_requests import hand_pose

    touched = []
    for number, point in enumerate(TOUCH_POINTS, start=1):
        if not ask(
            f"{number} of 3: guide the closed fingers to {point}, then press Enter: "
        ):
            raise ConfigurationError(
                "the input ended before Enter was pressed; nothing is changed"
            )
        touched.append(touched_point(hand_pose(robot)))
    mounting = mounting_from_points(np.array(touched), length)
    path = write_mounting(found, mounting)
    print(f"registered: {mounting}\n  {path}; its last line has the old mounting")


def _agree_to_motion(
    settings: "CellFile", arm: str | None, full_speed: bool, *, recover: bool = False
) -> "tuple[CellFile, Trial]":
    """Have the operator agree to a robot's motion; returns the settings and the trial.

    The doctor checks the robot first, except to `recover`, which must always be
    possible.
    """
    from cell.setup.arm.run_settings import agree_to_slow_motion

    chosen = settings.with_drivers(arm)
    return agree_to_slow_motion(chosen, ask, full_speed=full_speed, checked=not recover)


def _share(*, full_speed: bool) -> float:
    """Share of full speed at which joints move: that of a first run unless
    `full_speed`.
    """
    from cell.setup.arm.run_settings import FIRST_RUN_SPEED

    return 1.0 if full_speed else FIRST_RUN_SPEED


def _go_to(request: "GoTo", settings: "CellFile", where: str, done: str) -> None:
    """Move the robot's joints as `request` states, and print `done`."""
    from cell.setup.arm.manual_motion import robot_task
    from drivers.franka.joint_requests import go_to

    go_to(robot_task(settings), request, partial(_show_progress, where))
    _print_result(done, settings)


def _show_progress(where: str, share: float) -> None:
    """Show on a terminal how much of the way to `where` is done."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\rmoving {where}, {in_percent(share)} ")
        sys.stderr.flush()


def _move(
    settings: "CellFile",
    trial: "Trial",
    motion: "Callable[[Snapshot], Motion]",
    done: str = "",
) -> NoReturn:
    """Carry out one `motion`, print `done` or the outcome, and exit with the outcome's
    code.
    """
    from cell.orchestrator.operator import Interrupt
    from cell.setup.arm.manual_motion import move_manually

    with Interrupt() as interrupted:
        outcome = move_manually(settings, trial, motion, interrupted)
    text = f"{outcome.name}: {outcome.reason}"
    if done and outcome.exit_code == 0:
        text = done
    _print_result(text, settings)
    sys.exit(outcome.exit_code)


def _print_result(text: str, settings: "CellFile") -> None:
    """Print `text`, with a remark where the robot is emulated."""
    print(f"{text} ({settings.emulation})" if settings.emulation else text)
