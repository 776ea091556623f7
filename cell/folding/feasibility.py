"""Feasibility and prediction of a fold in its cell, by simulation, before anything
moves.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import product
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np

from calibration.calibration import Calibration, load_calibration
from cell.base.config.settings import CellSettings
from cell.base.devices.fold_path import largest_speed, whole_path
from cell.folding.request import Request
from cell.perception.preflight import check_scope
from cell.setup.arm.arm_prediction import ArmPrediction, predict_arm
from cell.setup.arm.run_settings import LEAST_SPEED, at_speed
from cell.setup.calibration_in_use import check_current
from drivers.base.errors import CellError, ConfigurationError, Fault, PreflightRefused
from drivers.base.installation import Installation
from drivers.base.types import Array, Pose
from drivers.franka.obstacles import desk_end, require_clear
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from policies.policy import Policy
from policies.registry import make_policy
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
    """Check that the cell can fold `strip`; returns the predicted displacement and its
    sigma [m].

    None where the layers do not touch in the model, whose images have noise by `seed`.
    The policy is reset. Raises PreflightRefused for a strip that this cell cannot see
    or fold within the limits of `settings`, or where the hand of a real arm would meet
    the desk, or the joints of a Franka arm could not follow.
    """
    arm = settings.arm_driver
    folds = _simulate(settings, strip, policy, seed)
    carry = _carry(strip, policy, settings.fold.speed, folds)
    touch = None if folds is None else folds.touch[0]
    path, speeds = whole_path(
        strip.length, settings.installation, settings.fold, carry, touch
    )
    places = np.vstack([path[1:, :2], carry])  # from beside the strip on
    # the workspace refuses any other path
    joints = arm.is_franka and np.isfinite(path).all()
    carry_at = partial(_carry_at, settings, strip, policy, seed)
    problems = [
        *(check.sentence() for check in check_scope(strip) if not check.passed),
        *_height_problems(settings, strip, policy),
        *path_problems(places, carry, settings, carry_at),
        *_view_problems(places, strip, calibration),
        *(_desk_collisions(settings.installation, strip, path) if arm.real else ()),
        *(
            _reach_problems(settings.installation, strip, path, speeds)
            if joints
            else ()
        ),
    ]
    if problems:
        raise PreflightRefused("\n".join(problems))
    return None if folds is None else _expected(folds, settings.sigma.displacement)


def path_problems(
    places: Array,
    carry: Array,
    settings: CellSettings,
    carry_at: Callable[[float], Array],
) -> Iterator[str]:
    """Yield a text for each limit of `settings` that keeps its arm from following a
    fold.

    The gripper passes `places` (n, 2) [m], and carries the strip along `carry` (k, 2)
    [m]; `carry_at` gives the latter at another speed [m/s].
    """
    yield from _workspace_problems(places, settings.installation)
    limits = settings.installation.limits
    speed = settings.fold.speed
    over = (
        f"speed: the path at {speed:g} m/s is over the arm's limits of velocity,"
        " acceleration "
    )
    over += "or jerk"
    try:
        # another speed gives another path
        while speed > (fits := largest_speed(carry, limits)):
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
            f"lay_speed: {settings.fold.lay_speed:g} m/s is over the arm's limits,"
            f" allowed at most {slowest:g} m/s; lower fold.lay_speed, or raise"
            " installation.limits in cell.yaml"
        )


def _desk_collisions(
    installation: Installation, strip: StripFile, path: Array
) -> Iterator[str]:
    """Yield a text where the hand at the poses `path` (n, 3) [m, m, rad] would meet the
    desk.
    """
    try:
        require_clear(
            [Pose(*pose) for pose in path.tolist()],
            desk_end(installation, strip.length),
        )
    except Fault as fault:
        yield f"desk: {fault}"


def _reach_problems(
    installation: Installation, strip: StripFile, path: Array, speeds: Array
) -> Iterator[str]:
    """Yield a text where the joints cannot follow `path` (n, 3) at `speeds` (n,)
    [m/s].
    """
    arm = predict_arm(installation, strip.length, path, speeds)
    if not arm.reach.allowed:
        yield (
            f"reach: the arm cannot follow the fold: {arm.reach.problems[0]}; fold a"
            " shorter strip, by another policy, or move robot or strip"
            " (installation.mounting in cell.yaml), see `cell fold --dry-run --arm"
            " fci`"
        )


def _carry(
    strip: StripFile, policy: Policy, speed: float, folds: Folds | None
) -> Array:
    """Gripper positions (n, 2) [m] of the first of `folds`, starting at the strip's
    lying edge.

    Where the simulation failed (None), the policy's lift at `speed` [m/s] takes its
    place.
    """
    if folds is None:
        policy.reset(strip, speed, 1)
    return from_edge(
        strip, policy.lift().points if folds is None else folds.trace[:, 0]
    )


def _carry_at(
    settings: CellSettings, strip: StripFile, policy: Policy, seed: int, speed: float
) -> Array:
    """Gripper positions (n, 2) [m] of a fold at another `speed` [m/s] than that of
    `settings`.
    """
    folds = _simulate(at_speed(settings, speed), strip, policy, seed)
    return _carry(strip, policy, speed, folds)


def from_edge(strip: StripFile, fold: Array) -> Array:
    """Gripper positions (n + 1, 2) [m] from the edge of `strip` on the desk through a
    `fold`.
    """
    return np.vstack([(strip.length, 0.0), fold])


def _simulate(
    settings: CellSettings, strip: StripFile, policy: Policy, seed: int
) -> Folds | None:
    """Simulated folds of `strip` and its corner strips; None if the simulation
    failed.
    """
    try:
        return simulate(settings, strip, policy, seed)
    except CellError:
        return None


def simulate(
    settings: CellSettings, strip: StripFile, policy: Policy, seed: int
) -> Folds:
    """Simulated folds of `strip`, then of its corner strips, by `policy` in a cell of
    `settings`.

    The policy is made for `strip`; `seed` is that of the noise in its images. Raises
    CellError for a strip or speed that the policy or the model does not allow.
    """
    models = [
        describe(each, settings.effects) for each in (strip, *corner_strips(strip))
    ]
    rollout = Rollout(speed=settings.fold.speed, sensing=IMAGE_DELAY)
    rng = np.random.default_rng(seed)
    return roll_out(policy, Rod(), strip, models, settings=rollout, rng=rng)


def _expected(folds: Folds, repeats: float) -> tuple[float, float] | None:
    """Displacement [m] of the first of `folds`, and its standard deviation with
    `repeats` [m].

    That of repeated folds is `repeats`. None where a fold does not touch.
    """
    if not np.isfinite(folds.displacement).all():
        return None
    corners = folds.displacement[1:]
    spread = float(np.std(corners)) if len(corners) else 0.0
    return float(folds.displacement[0]), hypot(spread, repeats)


def corner_strips(strip: StripFile) -> list[StripFile]:
    """Copies of `strip` with its uncertain parameters at all combinations of their
    bounds.
    """
    spans = []
    for key, spread in UNKNOWN_SPREADS.items():
        value = getattr(strip, key)
        spans.append(
            strip.spread.get(key, (value * (1 - spread), value * (1 + spread)))
        )
    corners = [
        dict(zip(UNKNOWN_SPREADS, corner, strict=True)) for corner in product(*spans)
    ]
    return [strip.model_copy(update=corner) for corner in corners]


def _height_problems(
    settings: CellSettings, strip: StripFile, policy: Policy
) -> Iterator[str]:
    """Yield a text where the policy's path does not rise to the take-over height."""
    top = float(policy.lift().points[:, 1].max())
    takeover = settings.fold.takeover_height
    if top <= takeover:
        yield (
            f"length: a fold of {strip.length:g} m rises to {top:.2f} m, the policy"
            f" takes over at {takeover:.2f} m; fold a longer strip, or lower"
            " fold.takeover_height in cell.yaml"
        )


def _workspace_problems(path: Array, installation: Installation) -> Iterator[str]:
    """Yield a text for each axis on which `path` (n, 2) [m] leaves the workspace."""
    box = installation.workspace
    for axis, name, (low, high) in ((0, "x", box.x), (1, "z", box.z)):
        least, most = float(path[:, axis].min()), float(path[:, axis].max())
        # true for NaN
        if not (low - PATH_ERROR <= least and most <= high + PATH_ERROR):
            yield (
                f"workspace: the gripper would move from {name} = {least:.2f} to"
                f" {most:.2f} m, allowed {low:.2f} to {high:.2f} m; fold a shorter"
                " strip, by another policy, or widen installation.workspace in"
                " cell.yaml"
            )


def _view_problems(
    path: Array, strip: StripFile, calibration: Calibration
) -> Iterator[str]:
    """Yield a text where the camera does not see the strip or the gripper on `path` (n,
    2) [m].
    """
    lens = calibration.lens
    lying = np.array([(0.0, 0.0), (strip.length, 0.0)])
    held = path[(path[:, 0] >= 0) & (path[:, 0] <= strip.length)]
    for what, points in (("the strip", lying), ("the gripper", held)):
        pixels = calibration.to_image(points)
        seen = (pixels >= 0).all(axis=1) & (pixels <= (lens.width, lens.height)).all(
            axis=1
        )
        if not seen.all():
            x, z = points[int(np.argmin(seen))]
            yield (
                f"view: the camera does not see {what} at x = {x:.2f}, z = {z:.2f} m;"
                " fold a shorter strip, or set the camera further away and calibrate"
                " again"
            )


@dataclass(frozen=True, slots=True)
class Prediction:
    """Predicted fold: displacement [m] with bounds, None without a touch; path's range
    x, z [m].
    """

    strip: str
    policy: str
    displacement: float | None
    low: float | None
    high: float | None
    reach: tuple[float, float, float, float]
    arm: ArmPrediction | None = None

    def line(self) -> dict[str, Any]:
        """JSON object of the prediction, as `cell fold --dry-run --json` prints it."""
        x_min, x_max, z_min, z_max = self.reach
        return {
            "strip": self.strip,
            "policy": self.policy,
            "displacement": self.displacement,
            "displacement_low": self.low,
            "displacement_high": self.high,
            "path": {"x": [x_min, x_max], "z": [z_min, z_max]},
            **({} if self.arm is None else {"arm": self.arm.line()}),
        }

    def __str__(self) -> str:
        """Text of the prediction for the operator."""
        x_min, x_max, z_min, z_max = (1e3 * value for value in self.reach)
        expected = "no touch"
        if self.displacement is not None:
            expected = f"displacement {1e3 * self.displacement:+.1f} mm"
        if self.low is not None and self.high is not None:
            expected += f", between {1e3 * self.low:+.1f} and {1e3 * self.high:+.1f} mm"
        return (
            f"{self.strip} by {self.policy}: expected {expected} over what is unknown"
            f" of the strip\n  the gripper stays within x {x_min:.0f} to {x_max:.0f}"
            f" mm, z {z_min:.0f} to {z_max:.0f} mm: inside its limits; nothing was"
            " moved" + ("" if self.arm is None else f"\n  {self.arm.text()}")
        )

    __repr__ = __str__


def predict(request: Request) -> Prediction:
    """Predict the fold of `request`; raises ConfigurationError for a path beyond its
    limits.

    The calibration that the cell file names is checked as a fold does.
    """
    settings = request.settings
    strip = request.strip
    if settings.calibration is not None:
        calibration = load_calibration(Path(settings.calibration))
        on_twin = not settings.camera_driver.real
        check_current(
            calibration, settings.calibration_days, datetime.now(UTC), on_twin=on_twin
        )
    policy, seed = _policy_in_rod(request), request.trial.seed
    folds = simulate(settings, strip, policy, seed)
    places = folds.trace.reshape(-1, 2)
    carry = from_edge(strip, folds.trace[:, 0])
    carry_at = partial(_carry_at, settings, strip, policy, seed)
    problems = list(path_problems(places, carry, settings, carry_at))
    if problems:
        raise ConfigurationError("\n".join(problems))
    x_min, z_min = places.min(axis=0).tolist()
    x_max, z_max = places.max(axis=0).tolist()
    nominal = folds.displacement[0]
    spread = folds.displacement[folds.touched]
    arm = None
    if settings.arm_driver.is_franka:
        place = settings.installation
        path, speeds = whole_path(
            strip.length, place, settings.fold, carry, folds.touch[0]
        )
        arm = predict_arm(place, strip.length, path, speeds)
    return Prediction(
        strip=strip.name,
        policy=request.policy,
        displacement=float(nominal) if np.isfinite(nominal) else None,
        low=float(spread.min()) if spread.size else None,
        high=float(spread.max()) if spread.size else None,
        reach=(x_min, x_max, z_min, z_max),
        arm=arm,
    )


def planned_path(request: Request) -> tuple[Array, Array]:
    """Poses (n, 3) x, z [m], pitch [rad] and speeds (n,) [m/s] of the fold of
    `request`.
    """
    settings, strip = request.settings, request.strip
    folds = simulate(settings, strip, _policy_in_rod(request), request.trial.seed)
    carry = from_edge(strip, folds.trace[:, 0])
    return whole_path(
        strip.length, settings.installation, settings.fold, carry, folds.touch[0]
    )


def _policy_in_rod(request: Request) -> Policy:
    """Policy of `request`, made for the rod: without a bias of images or of the
    cell.
    """
    return make_policy(request.policy, request.checkpoint, in_rod=True)
