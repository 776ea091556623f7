"""Feasibility of a fold in its cell, foreseen by simulation before anything moves."""

from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from itertools import product
from math import ceil, floor, hypot, inf
from typing import Any, Self

import numpy as np

from calibration.calibration import Calibration
from cell.base.config.settings import CellSettings
from cell.base.config.unmeasured_strip import UNKNOWN_NAME as UNKNOWN
from cell.base.devices.fold_path import largest_speed, triangle, whole_path
from cell.base.devices.rig_correction import corrected_calibration
from cell.folding.request import Request
from cell.perception.preflight import check_scope
from cell.setup.arm.arm_prediction import ArmPrediction, predict_arm
from cell.setup.arm.run_settings import LEAST_SPEED, at_speed
from cell.setup.calibration_in_use import check_current
from drivers.base.errors import (
    CellError,
    ConfigurationError,
    Fault,
    PreflightRefused,
    in_mm,
)
from drivers.base.installation import Installation
from drivers.base.types import Array, Pose
from drivers.franka.checks import joint_limits
from drivers.franka.obstacles import require_clear
from drivers.franka.shapes import desk_end, grip_problems
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from policies.policy import Policy, at_line
from policies.registry import make_policy
from policies.rollout import Folds, Rollout, roll_out
from policies.sensing import Sensing

IMAGE_DELAY = Sensing(delay=(0.03, 0.03))  # s
PATH_ERROR = 0.005  # m, error of the simulated path
# relative, where no spread is stated
UNKNOWN_SPREADS = {"bending_length": 0.1, "retardation_time": 0.5}
# tried where a fold is refused; the paths of the paper miss by centimetres
ALTERNATIVES = ("adaptive", "feedback", "shifted")
GOOD_FOLD = 0.02  # m, largest |d| that the paper claims
USUAL_LENGTH, LENGTH_STEP = 0.6, 0.02  # m, of a strip; of lengths that are tried


@dataclass(frozen=True, slots=True)
class Feasibility:
    """What a simulation foresees of the fold of a `request`, such as the gripper's
    path, and texts on the `problems` that forbid the fold.

    `path` (n, 3) x, z [m], pitch [rad] from home to retreat at `speeds` (n,) [m/s],
    `reach` of the joints of a Franka arm along it. The simulated `folds` are those of
    the strip and of its corner strips; None where the policy or the model refuses. Each
    of the `problems` forbids the fold; `advice` names what was tried and is allowed.
    """

    request: Request
    path: Array
    speeds: Array
    reach: ArmPrediction | None
    folds: Folds | None
    seen_by: Calibration
    problems: tuple[str, ...] = ()

    @property
    def advice(self) -> tuple[str, ...]:
        """Texts on what is allowed here where the fold is not, such as another policy
        or another length, found by trying these now; empty where the fold has no
        problem.
        """
        if not self.problems:
            return ()
        return (*_other_policies(self), *_nearest_length(self))

    def require(self) -> Self:
        """Return this object; raises PreflightRefused, whose text also holds the
        advice, where the fold has any problem.
        """
        if self.problems:
            raise PreflightRefused("\n".join((*self.problems, *self.advice)))
        return self

    @property
    def expected(self) -> tuple[float, float] | None:
        """Expected displacement [m] and its standard deviation [m], from what is
        unknown of the strip and from the scatter of repeated folds.

        None where a simulated fold ends without a touch.
        """
        folds = self.folds
        if folds is None or not folds.touched.all():
            return None
        spread = float(np.std(folds.displacement[1:]))
        repeats = self.request.settings.sigma.displacement
        return float(folds.displacement[0]), hypot(spread, repeats)

    @property
    def prediction(self) -> "Prediction":
        """Prediction of the fold for the operator; raises PreflightRefused where the
        fold has any problem.
        """
        folds = self.require().folds
        if folds is None:
            raise PreflightRefused("the model finds no prediction for this fold")
        return Prediction.from_folds(self.request, folds, self.reach)


def assess(request: Request, calibration: Calibration) -> Feasibility:
    """Foresee the fold of `request`, seen by the camera of `calibration`, by
    simulation, before anything moves.

    Problems are limits of policy, perception, workspace, speed, view and, of a real
    arm, desk and joints. Raises ConfigurationError or PreflightRefused for an
    implausible or expired calibration.
    """
    settings = request.settings
    on_twin = not settings.camera_driver.real
    check_current(
        calibration, settings.calibration_days, datetime.now(UTC), on_twin=on_twin
    )
    return _foresee(request, calibration)


def _foresee(request: Request, calibration: Calibration) -> Feasibility:
    """What a simulation foresees of the fold of `request`, and its problems; advice is
    not sought yet.
    """
    settings = request.settings
    strip = request.strip
    installation = settings.installation
    policy = _policy_in_rod(request)
    refusal = ""
    lift = triangle(strip.length)
    try:
        folds, carry = _simulated_carry(settings, request, policy)
        lift = policy.lift().points
    except ConfigurationError as error:
        refusal = str(error)
        folds = None
        carry = lift

    touch = None if folds is None else folds.touch[0]
    goal = request.line.goal
    path, speeds = whole_path(
        strip.length, installation, settings.fold, carry, touch, goal
    )
    # the workspace refuses any other path
    joints = settings.arm_driver.is_franka and np.isfinite(path).all()
    reach = None
    if joints:
        limits = joint_limits(settings.fci)
        reach = predict_arm(installation, limits, strip.length, path, speeds)

    passed = np.vstack([path[1:, :2], carry])  # from beside the strip on
    seen_by = corrected_calibration(calibration, settings, strip)
    unknown = () if folds is None else folds.trace.reshape(-1, 2)
    carry_at = partial(_carry_at, settings, request, policy)

    problems = [refusal] if refusal else []
    problems += (each.sentence() for each in check_scope(strip) if not each.passed)
    problems += _height_problems(settings, strip, lift)
    problems += path_problems(np.vstack([passed, *unknown]), carry, settings, carry_at)
    problems += _view_problems(passed, strip, seen_by)
    if settings.arm_driver.real:
        problems += _hand_problems(installation, strip, path)
    problems += _reach_problems(reach)
    return Feasibility(
        request=request,
        path=path,
        speeds=speeds,
        reach=reach,
        folds=folds,
        seen_by=calibration,
        problems=tuple(problems),
    )


def _other_policies(refused: Feasibility) -> Iterator[str]:
    """Yield a text on that policy, of those by which the `refused` fold is allowed,
    whose displacement is expected to be least at worst; nothing where there is none.
    """
    allowed = []
    for name in ALTERNATIVES:
        other = replace(refused.request, policy=name, checkpoint=None)
        foreseen = _foresee(other, refused.seen_by)
        if not foreseen.problems and foreseen.expected is not None:
            allowed.append(foreseen.prediction)
    if allowed:
        best = min(allowed, key=lambda prediction: prediction.largest_miss)
        yield f"allowed here is --policy {best.policy}: {best.expectation()}"


def _nearest_length(refused: Feasibility) -> Iterator[str]:
    """Yield a text on the nearest round length of the strip at which the `refused` fold
    is allowed, or nothing where there is none.

    Between the usual length and that of the fold, which is too long or too short.
    """
    request = refused.request
    usual = USUAL_LENGTH / LENGTH_STEP
    far = request.strip.length / LENGTH_STEP
    steps = (
        range(round(usual), ceil(far))
        if far > usual
        else range(round(usual), floor(far), -1)
    )

    def is_refused(step: int) -> bool:
        length = step * LENGTH_STEP
        strip = request.strip.model_copy(update={"length": length})
        share = length / request.strip.length
        at = None if request.at is None else request.at * share
        cut = replace(request, strip=strip, at=at)
        return bool(_foresee(cut, refused.seen_by).problems)

    allowed = steps[: bisect_left(steps, True, key=is_refused)]
    if allowed:
        length = f"{1e3 * LENGTH_STEP * allowed[-1]:.0f}mm"
        what = "--length" if request.strip.name == UNKNOWN else "a strip of"
        yield f"allowed here is {what} {length}, by --policy {request.policy}"


def path_problems(
    points: Array,
    carry: Array,
    settings: CellSettings,
    carry_at: Callable[[float], Array],
) -> Iterator[str]:
    """Yield a text for each limit in `settings`, such as workspace and speed, that
    keeps the arm from following a fold.

    The gripper passes `points` (n, 2) [m], and carries the strip along `carry` (k, 2)
    [m]; `carry_at` gives the latter at another speed [m/s].
    """
    lay_speed = settings.fold.lay_speed
    yield from _workspace_problems(points, settings.installation)
    limits = settings.installation.limits
    speed = settings.fold.speed
    over = (
        f"speed: the path at {speed:g} m/s is over the arm's limits of velocity,"
        " acceleration or jerk"
    )

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
    if lay_speed > slowest:
        yield (
            f"lay_speed: {lay_speed:g} m/s is over the arm's limits,"
            f" allowed at most {slowest:g} m/s; lower fold.lay_speed, or raise"
            " installation.limits in cell.yaml"
        )


def _hand_problems(
    installation: Installation, strip: StripFile, path: Array
) -> Iterator[str]:
    """Yield a text where the hand cannot hold `strip`, or would touch the desk at one
    of the poses in `path`, which has rows of x [m], z [m] and pitch [rad].
    """
    yield from grip_problems(strip.width)
    try:
        require_clear(
            [Pose(*pose) for pose in path.tolist()],
            desk_end(installation, strip.length),
        )
    except Fault as fault:
        yield f"desk: {fault}"


def _reach_problems(arm: ArmPrediction | None) -> Iterator[str]:
    """Yield a text where the joints of the predicted `arm` cannot follow a fold; None
    stands for an arm whose joints are not known.
    """
    if arm is not None and not arm.reach.allowed:
        yield (
            f"reach: the arm cannot follow the fold: {arm.reach.problems[0]}; move"
            " robot or strip (installation.mounting in cell.yaml)"
        )


def _simulated_carry(
    settings: CellSettings, request: Request, policy: Policy
) -> tuple[Folds | None, Array]:
    """Simulated folds by `policy`, and the gripper's positions in the first of them,
    with a row of x and z [m] for each.

    Where the simulation fails, the folds are None and the positions those of the
    policy's lift. Raises ConfigurationError for a strip or speed that the policy does
    not allow.
    """
    strip = request.strip
    try:
        folds = simulate(settings, strip, policy, request.trial.seed)
        relative = folds.displacement + request.line.goal
        folds = replace(folds, displacement=relative)
    except ConfigurationError:
        raise
    except CellError:
        policy.reset(strip, settings.fold.speed, 1)
        return None, _from_edge(strip, policy.lift().points)
    return folds, _from_edge(strip, folds.trace[:, 0])


def _carry_at(
    settings: CellSettings, request: Request, policy: Policy, speed: float
) -> Array:
    """Positions of the gripper in a simulated fold at another `speed` [m/s] than that
    of `settings`, with a row of x and z [m] for each.
    """
    return _simulated_carry(at_speed(settings, speed), request, policy)[1]


def _from_edge(strip: StripFile, fold: Array) -> Array:
    """Positions of the gripper during a `fold`, with the edge of the lying `strip` put
    before them; each row holds x and z [m].
    """
    return np.vstack([(strip.length, 0.0), fold])


def simulate(
    settings: CellSettings, strip: StripFile, policy: Policy, seed: int
) -> Folds:
    """Simulate the fold of `strip`, and of copies whose uncertain parameters lie at
    their bounds, by `policy` in a cell with `settings`.

    The policy is made for `strip`; `seed` is that of the noise in its images. Raises
    CellError for a strip or speed that the policy or the model does not allow.
    """
    models = [
        describe(each, settings.effects) for each in (strip, *corner_strips(strip))
    ]
    rollout = Rollout(speed=settings.fold.speed, sensing=IMAGE_DELAY)
    rng = np.random.default_rng(seed)
    return roll_out(policy, Rod(), strip, models, settings=rollout, rng=rng)


def corner_strips(strip: StripFile) -> list[StripFile]:
    """Copies of `strip` with its uncertain parameters at all combinations of their
    lower and upper bounds.
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
    settings: CellSettings, strip: StripFile, lift: Array
) -> Iterator[str]:
    """Yield a text where a strip is so short that its first `lift`, rows of x and z
    [m], ends below the height at which the policy takes over.
    """
    top = lift[:, 1].max()
    takeover = settings.fold.takeover_height
    if top <= takeover:
        yield (
            f"length: a fold of {strip.length:g} m rises to {top:.2f} m, the policy"
            f" takes over at {takeover:.2f} m; lower fold.takeover_height in cell.yaml"
        )


def _workspace_problems(path: Array, installation: Installation) -> Iterator[str]:
    """Yield a text for each axis along which `path`, with rows of x and z [m], leaves
    the workspace of the arm.
    """
    box = installation.workspace
    for axis, name, (low, high) in ((0, "x", box.x), (1, "z", box.z)):
        least = path[:, axis].min()
        most = path[:, axis].max()
        # true for NaN
        if not (low - PATH_ERROR <= least and most <= high + PATH_ERROR):
            yield (
                f"workspace: the gripper would move from {name} = {least:.2f} to"
                f" {most:.2f} m, allowed {low:.2f} to {high:.2f} m; widen"
                " installation.workspace in cell.yaml"
            )


def _view_problems(
    path: Array, strip: StripFile, calibration: Calibration
) -> Iterator[str]:
    """Yield a text where the camera does not see the lying strip, or the gripper on its
    `path`, with rows of x and z [m].
    """
    lens = calibration.lens
    lying = np.array([(0.0, 0.0), (strip.length, 0.0)])
    over_strip = path[(path[:, 0] >= 0) & (path[:, 0] <= strip.length)]
    for what, points in (("the strip", lying), ("the gripper", over_strip)):
        pixels = calibration.to_image(points)
        seen = (pixels >= 0).all(axis=1) & (pixels <= lens.size).all(axis=1)
        if not seen.all():
            x, z = points[int(np.argmin(seen))]
            yield (
                f"view: the camera does not see {what} at x = {x:.2f}, z = {z:.2f} m;"
                " set the camera further away and calibrate again"
            )


@dataclass(frozen=True, slots=True)
class Prediction:
    """What is expected of a fold: its displacement [m] with bounds, None where the
    layers do not touch, and the range of the gripper's path.
    """

    strip: str
    policy: str
    displacement: float | None
    low: float | None
    high: float | None
    reach: tuple[float, float, float, float]
    arm: ArmPrediction | None = None
    folded_at: float | None = None

    @classmethod
    def from_folds(
        cls, request: Request, folds: Folds, arm: ArmPrediction | None
    ) -> Self:
        """Prediction for `request` from the simulated `folds` of its strip, which is
        the first, and of its copies with parameters at their bounds.
        """
        points = folds.trace.reshape(-1, 2)
        x_min, z_min = points.min(axis=0)
        x_max, z_max = points.max(axis=0)
        nominal = float(folds.displacement[0])
        spread = folds.displacement[folds.touched]
        return cls(
            strip=request.strip.name,
            policy=request.policy,
            displacement=nominal if np.isfinite(nominal) else None,
            low=float(spread.min()) if spread.size else None,
            high=float(spread.max()) if spread.size else None,
            reach=(float(x_min), float(x_max), float(z_min), float(z_max)),
            arm=arm,
            folded_at=None if request.line.is_half else request.line.at,
        )

    @property
    def largest_miss(self) -> float:
        """Largest size [m] of the displacement within its bounds; infinity where no
        touch of the layers is predicted.
        """
        if self.displacement is None or self.low is None or self.high is None:
            return inf
        return max(-self.low, self.high)

    def line(self) -> dict[str, Any]:
        """Content of the JSON object that `cell fold --dry-run --json` prints on the
        prediction.
        """
        x_min, x_max, z_min, z_max = self.reach
        return {
            "strip": self.strip,
            "policy": self.policy,
            "displacement": self.displacement,
            "displacement_low": self.low,
            "displacement_high": self.high,
            "path": {"x": [x_min, x_max], "z": [z_min, z_max]},
            **({} if self.folded_at is None else {"line": self.folded_at}),
            **({} if self.arm is None else {"arm": self.arm.line()}),
        }

    def expectation(self) -> str:
        """Text of the expected displacement, in millimetres, with its bounds."""
        expected = "no touch"
        if self.displacement is not None:
            expected = f"displacement {1e3 * self.displacement:+.1f} mm"
        if self.low is not None and self.high is not None:
            expected += f", between {1e3 * self.low:+.1f} and {1e3 * self.high:+.1f} mm"
        return f"expected {expected} over what is unknown of the strip"

    def __str__(self) -> str:
        """Text of the prediction for the operator, of several lines."""
        x_min, x_max, z_min, z_max = (1e3 * value for value in self.reach)
        lines = [
            f"{self.strip} by {self.policy}: {self.expectation()}",
            f"the gripper stays within x {x_min:.0f} to {x_max:.0f} mm, z {z_min:.0f}"
            f" to {z_max:.0f} mm: inside its limits; nothing was moved",
        ]
        if self.largest_miss > GOOD_FOLD:
            lines.append(f"it may miss by more than {in_mm(GOOD_FOLD)}")
        if self.arm is not None:
            lines.append(self.arm.text())
        return "\n  ".join(lines)

    __repr__ = __str__


def _policy_in_rod(request: Request) -> Policy:
    """Policy of `request` for the simulated strip, whose aim is corrected and whose
    images have no error.
    """
    policy = make_policy(request.policy, request.checkpoint, in_rod=True)
    request.learning.correction.apply(policy)
    return at_line(policy, request.line)
