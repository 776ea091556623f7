"""Feasibility of a fold in its cell, checked from files before anything moves."""

from collections.abc import Iterator

import numpy as np

from calibration.calibration import Calibration
from cell.config.settings import CellSettings
from cell.devices.fold_path import largest_speed, whole_path
from cell.perception.preflight import check_scope
from drivers.arm.obstacles import require_clear
from drivers.errors import CellError, Fault, PreflightRefused
from drivers.installation import Installation, MotionLimits
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.types import Array, Pose
from policies.policy import Policy
from policies.rollout import Rollout, roll_out
from policies.sensing import Sensing

SEGMENTS = 60  # of the model that draws the path; millimetres do not matter here
ARM_REACH = 0.78  # m from its base that a Panda's hand reaches over a desk, pointing down
PATH_ERROR = 0.005  # m that the path may be drawn wrong by
APPROACH_POINTS, RETREAT_POINTS = 3, 3  # of the gripper's path, before and after the fold


def check_feasible(
    settings: CellSettings,
    strip: StripFile,
    policy: Policy,
    calibration: Calibration,
    limits: MotionLimits,
    desk: float = 0.0,
) -> None:
    """Raise PreflightRefused for a strip that this cell cannot see, reach or fold.

    Its arm moves within `limits`. Also where the hand would meet a desk that ends at `desk` [m], 0
    for an arm without a hand's body. The gripper's path is that of `policy` in the model; it is
    reset.
    """
    path = gripper_path(settings, strip, policy)
    carry = path[APPROACH_POINTS - 1 : -RETREAT_POINTS]  # from the grasp on
    problems = [
        *(check.sentence() for check in check_scope(strip) if not check.passed),
        *_height_problems(settings, strip, policy),
        *path_problems(path, carry, settings, limits),
        *_reach_problems(path, settings.installation),
        *_view_problems(path, strip, calibration),
        *(_desk_collisions(carry, settings, strip, desk) if desk else ()),
    ]
    if problems:
        raise PreflightRefused("\n".join(problems))


def path_problems(
    places: Array, carry: Array, settings: CellSettings, limits: MotionLimits
) -> Iterator[str]:
    """Reasons why an arm within `limits` cannot follow a fold, a line each; none where it can.

    The gripper comes to `places` (n, 2) [m], and carries the strip along `carry` (k, 2) [m].
    """
    yield from _workspace_problems(places, settings.installation)
    fits = largest_speed(carry, limits)
    if settings.fold.speed > fits:
        yield (
            f"speed: the path at {settings.fold.speed:g} m/s is over the arm's limits of velocity, "
            f"acceleration or jerk, allowed at most {_rounded_down(fits):g} m/s; lower fold.speed, "
            "or raise installation.limits in cell.yaml"
        )
    slowest = min(limits.x.velocity, limits.z.velocity)
    if settings.fold.lay_speed > slowest:
        yield (
            f"lay_speed: {settings.fold.lay_speed:g} m/s is over the arm's limits, allowed at most "
            f"{slowest:g} m/s; lower fold.lay_speed, or raise installation.limits in cell.yaml"
        )


def _rounded_down(speed: float) -> float:
    return float(np.floor(1e4 * speed) / 1e4)


def _desk_collisions(
    carry: Array, settings: CellSettings, strip: StripFile, desk: float
) -> Iterator[str]:
    home, limits = settings.fold.clear_height, settings.installation.limits
    whole, _ = whole_path(strip.length, home, settings.fold, limits, carry)
    try:
        require_clear([Pose(*pose) for pose in whole.tolist()], desk)
    except Fault as fault:
        yield f"desk: {fault}"


def gripper_path(settings: CellSettings, strip: StripFile, policy: Policy) -> Array:
    """Gripper positions (n, 2) [m] of approach, the fold as the model predicts it, and retreat."""
    beyond, aside = strip.length + settings.fold.approach, settings.fold.approach
    before = [(beyond, settings.fold.clear_height), (beyond, 0.0), (strip.length, 0.0)]
    after = [(0.0, 0.0), (-aside, 0.0), (-aside, 2 * aside)]
    return np.vstack([before, _fold_path(settings, strip, policy), after])


def _fold_path(settings: CellSettings, strip: StripFile, policy: Policy) -> Array:
    """Gripper positions (n, 2) [m] of the simulated fold; those of the lift where that fails."""
    speed = settings.fold.speed
    rollout = Rollout(speed=speed, sensing=Sensing(delay=(0.03, 0.03)))
    rng = np.random.default_rng(0)
    try:
        model = [describe(strip, settings.effects)]
        folds = roll_out(policy, Rod(SEGMENTS), strip, model, settings=rollout, rng=rng)
    except CellError:  # the model cannot follow this strip; the path to begin with is known
        policy.reset(strip, speed, 1)
        return policy.lift().points
    return folds.trace.reshape(-1, 2)


def _height_problems(settings: CellSettings, strip: StripFile, policy: Policy) -> Iterator[str]:
    top, takeover = float(policy.lift().points[:, 1].max()), settings.fold.takeover_height
    if top <= takeover:
        yield (
            f"length: a fold of {strip.length:g} m rises to {top:.2f} m, the policy takes over at "
            f"{takeover:.2f} m; fold a longer strip, or lower fold.takeover_height in cell.yaml"
        )


def _workspace_problems(path: Array, installation: Installation) -> Iterator[str]:
    box = installation.workspace
    for axis, name, (low, high) in ((0, "x", box.x), (1, "z", box.z)):
        least, most = float(path[:, axis].min()), float(path[:, axis].max())
        if least < low - PATH_ERROR or most > high + PATH_ERROR:
            yield (
                f"workspace: the gripper would move from {name} = {least:.2f} to {most:.2f} m, "
                f"allowed {low:.2f} to {high:.2f} m; fold a shorter strip, by another policy, or "
                "widen installation.workspace in cell.yaml"
            )


def _reach_problems(path: Array, installation: Installation) -> Iterator[str]:
    mounting = installation.mounting
    away = np.hypot(
        mounting.x + path[:, 0] * np.cos(mounting.yaw),
        mounting.y + path[:, 0] * np.sin(mounting.yaw),
    )
    if float(away.max()) > ARM_REACH + PATH_ERROR:
        yield (
            f"reach: the gripper would be {away.max():.2f} m from the robot's base, its hand "
            f"reaches {ARM_REACH:.2f} m; fold a shorter strip, or mount the robot nearer "
            "(installation.mounting in cell.yaml)"
        )


def _view_problems(path: Array, strip: StripFile, calibration: Calibration) -> Iterator[str]:
    lens = calibration.lens
    lying = np.array([(0.0, 0.0), (strip.length, 0.0)])
    held = path[(path[:, 0] >= 0) & (path[:, 0] <= strip.length)]
    for what, points in (("the strip", lying), ("the gripper", held)):
        pixels = calibration.to_image(points)
        seen = (pixels >= 0).all(axis=1) & (pixels <= (lens.width, lens.height)).all(axis=1)
        if not seen.all():
            x, z = points[int(np.argmin(seen))]
            yield (
                f"view: the camera does not see {what} at x = {x:.2f}, z = {z:.2f} m; fold a "
                "shorter strip, or set the camera further away and calibrate again"
            )
