"""Feasibility of a fold in its cell, checked from files before anything moves."""

from collections.abc import Callable, Iterator
from itertools import product
from math import hypot

import numpy as np

from calibration.calibration import Calibration
from cell.arm.arm_prediction import predict_arm
from cell.arm.run_settings import LEAST_SPEED, at_speed
from cell.config.settings import CellSettings
from cell.devices.fold_path import largest_speed, whole_path
from cell.perception.preflight import check_scope
from drivers.arm.obstacles import desk_end, require_clear
from drivers.errors import CellError, ConfigurationError, Fault, PreflightRefused
from drivers.installation import Installation
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from drivers.types import Array, Pose
from policies.policy import Policy
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import Sensing

IMAGE_DELAY = Sensing(delay=(0.03, 0.03))  # s
PATH_ERROR = 0.005  # m, error of the simulated path
# relative, where no spread is stated
UNKNOWN_SPREADS = {"bending_length": 0.1, "retardation_time": 0.5}


def check_feasible(
    settings: CellSettings,
    strip: StripFile,
    policy: Policy,
    calibration: Calibration,
    seed: int = 0,
) -> tuple[float, float] | None:
    """Check that the cell can fold `strip`; returns the predicted displacement and its sigma [m].

    None where the layers do not touch in the model, whose images have noise by `seed`. The policy
    is reset. Raises PreflightRefused for a strip that this cell cannot see or fold within the
    limits of `settings`, or where the hand of a real arm would meet the desk, or the joints of a
    Franka arm could not follow.
    """
    arm = settings.arm_driver
    folds = _simulate(settings, strip, policy, seed)
    carry = _carry(settings, strip, policy, folds)
    touch = None if folds is None else folds.touch[0]
    path, speeds = whole_path(strip.length, settings.installation, settings.fold, carry, touch)
    places = np.vstack([path[1:, :2], carry])  # from beside the strip on
    joints = arm.is_franka and np.isfinite(path).all()  # the workspace refuses any other path

    def carry_at(speed: float) -> Array:
        slower = at_speed(settings, speed)
        return _carry(slower, strip, policy, _simulate(slower, strip, policy, seed))

    problems = [
        *(check.sentence() for check in check_scope(strip) if not check.passed),
        *_height_problems(settings, strip, policy),
        *path_problems(places, carry, settings, carry_at),
        *_view_problems(places, strip, calibration),
        *(_desk_collisions(settings.installation, strip, path) if arm.real else ()),
        *(_reach_problems(settings.installation, strip, path, speeds) if joints else ()),
    ]
    if problems:
        raise PreflightRefused("\n".join(problems))
    return None if folds is None else _expected(folds, settings.sigma.displacement)


def path_problems(
    places: Array, carry: Array, settings: CellSettings, carry_at: Callable[[float], Array]
) -> Iterator[str]:
    """Yield a text for each limit of `settings` that keeps its arm from following a fold.

    The gripper passes `places` (n, 2) [m], and carries the strip along `carry` (k, 2) [m];
    `carry_at` gives the latter at another speed [m/s].
    """
    yield from _workspace_problems(places, settings.installation)
    limits = settings.installation.limits
    speed = settings.fold.speed
    over = f"speed: the path at {speed:g} m/s is over the arm's limits of velocity, acceleration "
    over += "or jerk"
    try:
        while speed > (fits := largest_speed(carry, limits)):  # another speed gives another path
            speed = np.floor(1e4 * fits) / 1e4
            carry = carry_at(max(speed, LEAST_SPEED))
    except ConfigurationError as unknown:
        yield f"{over}; slower, {unknown}"
    else:
        if settings.fold.speed > speed:
            yield (
                f"{over}, allowed at most {speed:g} m/s; lower fold.speed, or raise "
                "installation.limits in cell.yaml"
            )
    slowest = min(limits.x.velocity, limits.z.velocity)
    if settings.fold.lay_speed > slowest:
        yield (
            f"lay_speed: {settings.fold.lay_speed:g} m/s is over the arm's limits, allowed at most "
            f"{slowest:g} m/s; lower fold.lay_speed, or raise installation.limits in cell.yaml"
        )


def _desk_collisions(installation: Installation, strip: StripFile, path: Array) -> Iterator[str]:
    """Yield a text where the hand at the poses `path` (n, 3) [m, m, rad] would meet the desk."""
    try:
        require_clear([Pose(*pose) for pose in path.tolist()], desk_end(installation, strip.length))
    except Fault as fault:
        yield f"desk: {fault}"


def _reach_problems(
    installation: Installation, strip: StripFile, path: Array, speeds: Array
) -> Iterator[str]:
    """Yield a text where the joints cannot follow `path` (n, 3) at `speeds` (n,) [m/s]."""
    arm = predict_arm(installation, strip.length, path, speeds)
    if not arm.reach.allowed:
        yield (
            f"reach: the arm cannot follow the fold: {arm.reach.problems[0]}; fold a shorter "
            "strip, by another policy, or move robot or strip (installation.mounting in "
            "cell.yaml), see `cell fold --dry-run --arm fci`"
        )


def _carry(settings: CellSettings, strip: StripFile, policy: Policy, folds: Folds | None) -> Array:
    """Gripper positions (n, 2) [m] of the first of `folds`, starting at the strip's lying edge.

    Where the simulation failed (None), the policy's lift takes its place.
    """
    if folds is None:
        policy.reset(strip, settings.fold.speed, 1)
    return from_edge(strip, policy.lift().points if folds is None else folds.trace[:, 0])


def from_edge(strip: StripFile, fold: Array) -> Array:
    """Gripper positions (n + 1, 2) [m] from the edge of `strip` on the desk through a `fold`."""
    return np.vstack([(strip.length, 0.0), fold])


def _simulate(settings: CellSettings, strip: StripFile, policy: Policy, seed: int) -> Folds | None:
    """Simulated folds of `strip` and its corner strips; None if the simulation failed."""
    try:
        return simulate(settings, strip, policy, seed)
    except CellError:
        return None


def simulate(settings: CellSettings, strip: StripFile, policy: Policy, seed: int) -> Folds:
    """Simulated folds of `strip`, then of its corner strips, by `policy` in a cell of `settings`.

    The policy is made for `strip`; `seed` is that of the noise in its images. Raises CellError for
    a strip or speed that the policy or the model does not allow.
    """
    models = [describe(each, settings.effects) for each in (strip, *corner_strips(strip))]
    rollout = Rollout(speed=settings.fold.speed, sensing=IMAGE_DELAY)
    rng = np.random.default_rng(seed)
    return roll_out(policy, Rod(), strip, models, settings=rollout, rng=rng)


def _expected(folds: Folds, repeats: float) -> tuple[float, float] | None:
    """Displacement [m] of the first of `folds`, and its standard deviation with `repeats` [m].

    That of repeated folds is `repeats`. None where a fold does not touch.
    """
    if not np.isfinite(folds.displacement).all():
        return None
    corners = folds.displacement[1:]
    spread = float(np.std(corners)) if len(corners) else 0.0
    return float(folds.displacement[0]), hypot(spread, repeats)


def corner_strips(strip: StripFile) -> list[StripFile]:
    """Copies of `strip` with its uncertain parameters at all combinations of their bounds."""
    spans = []
    for key, spread in UNKNOWN_SPREADS.items():
        value = getattr(strip, key)
        spans.append(strip.spread.get(key, (value * (1 - spread), value * (1 + spread))))
    corners = [dict(zip(UNKNOWN_SPREADS, corner, strict=True)) for corner in product(*spans)]
    return [strip.model_copy(update=corner) for corner in corners]


def _height_problems(settings: CellSettings, strip: StripFile, policy: Policy) -> Iterator[str]:
    """Yield a text where the policy's path does not rise to the take-over height."""
    top = float(policy.lift().points[:, 1].max())
    takeover = settings.fold.takeover_height
    if top <= takeover:
        yield (
            f"length: a fold of {strip.length:g} m rises to {top:.2f} m, the policy takes over at "
            f"{takeover:.2f} m; fold a longer strip, or lower fold.takeover_height in cell.yaml"
        )


def _workspace_problems(path: Array, installation: Installation) -> Iterator[str]:
    """Yield a text for each axis on which `path` (n, 2) [m] leaves the workspace."""
    box = installation.workspace
    for axis, name, (low, high) in ((0, "x", box.x), (1, "z", box.z)):
        least, most = float(path[:, axis].min()), float(path[:, axis].max())
        if not (low - PATH_ERROR <= least and most <= high + PATH_ERROR):  # true for NaN
            yield (
                f"workspace: the gripper would move from {name} = {least:.2f} to {most:.2f} m, "
                f"allowed {low:.2f} to {high:.2f} m; fold a shorter strip, by another policy, or "
                "widen installation.workspace in cell.yaml"
            )


def _view_problems(path: Array, strip: StripFile, calibration: Calibration) -> Iterator[str]:
    """Yield a text where the camera does not see the strip or the gripper on `path` (n, 2) [m]."""
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
