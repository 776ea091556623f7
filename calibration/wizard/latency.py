"""Camera latency from steps of the arm: the pointer in images against the arm's
positions.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from pydantic import ConfigDict, Field

from calibration.board import find_pointer
from calibration.homography import PlaneMap
from calibration.wizard.verdict import CalibrationVerdict, grade_line, reasons
from drivers.base.settings import Settings
from drivers.base.types import ArmState, Array, Frame, Pose

# ms between two halves of the images, up to which good, then fair
APART_GRADES = (2.0, 5.0)
DRIFT_LOSS_SCALE = 5e-4  # m, error from which an image counts less
DRIFT_SIGMA = 6.0  # sigma by which a drift must differ from zero
MOVING_SPEED = 0.02  # m/s of the pointer from which an image reveals the latency
FIRST_STEP = 0.005  # s between the latencies that are tried first


class LatencySettings(Settings):
    """Settings of the latency measurement and its acceptance criteria.

    The arm makes `steps` moves of `step` [m] along x from (`x`, `z`) and back. `most`
    is the largest plausible latency and `uncertainty` the allowed difference between
    two halves of the images, both [s]; `images` is the number required in motion.
    """

    x: float = Field(0.25, ge=-0.5, le=2.0)
    z: float = Field(0.15, ge=0.02, le=1.0)
    step: float = Field(0.12, ge=0.02, le=0.4)
    steps: int = Field(6, ge=2, le=40)
    images: int = Field(10, ge=4)
    most: float = Field(0.3, gt=0, le=1)
    uncertainty: float = Field(0.005, gt=0, le=0.1)
    # rms between image and arm at the best latency
    misfit_mm: float = Field(2.0, gt=0, le=20)


@dataclass(frozen=True, slots=True)
class LatencyVerdict(CalibrationVerdict):
    """Measured `latency` [s], the time from an exposure to its stamp."""

    latency: float | None = None


class LatencySteps(Settings):
    """Arm and images during the arm's steps, the content of latency.json.

    `arm` has rows t [s], x, z [m] of the gripper, `seen` rows t [s], u, v [px] of the
    pointer.
    """

    model_config = ConfigDict(extra="ignore")  # a program writes it

    arm: list[tuple[float, float, float]] = Field(default_factory=list)
    seen: list[tuple[float, float, float]] = Field(default_factory=list)

    def tell_arm(self, state: ArmState) -> None:
        """Add the arm's newest `state`, unless it is no newer than the last one that
        was added.
        """
        arm = self.arm
        if not arm or state.stamp > arm[-1][0]:
            arm.append((state.stamp, state.pose.x, state.pose.z))

    def tell_frame(self, frame: Frame) -> None:
        """Add the position of the pointer in a new image; an image that does not show
        the pointer is ignored.
        """
        centre = find_pointer(frame.image)
        if centre is not None:
            u, v = centre.tolist()
            self.seen.append((frame.stamp, u, v))


def step_poses(settings: LatencySettings) -> tuple[Pose, ...]:
    """Poses of the pointer between which the arm steps to and fro, in the order in
    which it takes them.
    """
    positions = (settings.x, settings.x + settings.step)
    return tuple(
        Pose(positions[k % 2], settings.z, pi / 2) for k in range(settings.steps + 1)
    )


def latency_verdict(
    steps: LatencySteps, plane_map: PlaneMap | None, settings: LatencySettings
) -> LatencyVerdict:
    """Verdict on the camera's latency, measured from `steps` of the arm; `plane_map`
    takes points of the image to the plane of the strip, None where it is not known.
    """
    told = steps.arm
    most = settings.most
    if plane_map is None or not told:
        return LatencyVerdict(reasons=("the latency was not measured",))
    if len(told) < 2 or len(steps.seen) == 0:
        return LatencyVerdict(reasons=("no step of the arm was seen; step again",))
    arm: Array = np.array(told)
    seen: Array = np.array(steps.seen)
    times = arm[:, 0]
    inside = (seen[:, 0] > times[0] + most) & (seen[:, 0] < times[-1])
    stamps = seen[inside, 0]
    along = plane_map.to_plane(seen[inside, 1:])[:, 0]

    arm_speed = np.abs(np.gradient(arm[:, 1], times))
    moving = np.count_nonzero(np.interp(stamps, times, arm_speed) > MOVING_SPEED)
    if moving < settings.images:
        reason = (
            f"{moving} images show the pointer under way, {settings.images}"
            " are needed; step again, uncover it"
        )
        return LatencyVerdict(reasons=(reason,))

    latency, misfit = _best_latency(arm, stamps, along, most)
    even, odd = (_best_latency(arm, stamps[k::2], along[k::2], most)[0] for k in (0, 1))
    apart = abs(even - odd)
    drift = _drift_reasons(arm, stamps, along, latency, settings)
    refused = drift or _reasons(latency, apart, 1e3 * misfit, settings)
    if refused:
        return LatencyVerdict(latency=latency, reasons=refused)

    late = round(1e3 * latency, 1) + 0.0  # never minus nothing
    text = f"images are stamped {late:.1f} ms late, known within {1e3 * apart:.1f} ms"
    found = grade_line(1e3 * apart, *APART_GRADES, f"{text}; the cell corrects it")
    return LatencyVerdict(latency=latency, found=(found,))


def _drift_reasons(
    arm: Array, stamps: Array, along: Array, latency: float, settings: LatencySettings
) -> tuple[str, ...]:
    """Texts on why a latency is refused that drifts during the arm's steps, as it does
    where the two clocks run at unequal rates; empty where it does not.
    """
    rate, rate_sigma = _drift_rate(arm, stamps, along, latency)
    duration = np.ptp(stamps)
    drift = rate * duration
    if abs(drift) <= settings.uncertainty or abs(rate) < DRIFT_SIGMA * rate_sigma:
        return ()
    return (
        (
            f"the camera's stamps drift against the arm's, by {1e3 * drift:+.0f} ms"
            f" over {duration:.0f} s (allowed {1e3 * settings.uncertainty:.0f} ms): the"
            " two do not run by one clock; stamp images by the machine's monotonic"
            " clock"
        ),
    )


def _drift_rate(
    arm: Array, stamps: Array, along: Array, latency: float
) -> tuple[float, float]:
    """Rate [s/s] at which the latency of the images changes with time, and its standard
    error, by a fit that outliers hardly affect.
    """
    from scipy.optimize import least_squares

    since = stamps - stamps.mean()

    def errors(unknown: Array) -> Array:
        late, drift, offset = unknown
        exposed = stamps - (late + drift * since)
        apart: Array = along - np.interp(exposed, arm[:, 0], arm[:, 1]) - offset
        return apart

    start = (latency, 0.0, 0.0)
    fit = least_squares(
        errors, start, loss="cauchy", f_scale=DRIFT_LOSS_SCALE, x_scale="jac"
    )
    noise = np.mean(errors(fit.x) ** 2)
    covariance = noise * np.linalg.pinv(fit.jac.T @ fit.jac)
    return float(fit.x[1]), float(np.sqrt(covariance[1, 1]))


def _best_latency(
    arm: Array, stamps: Array, along: Array, most: float
) -> tuple[float, float]:
    """Latency [s], at most `most` [s] in size, at which images and arm agree best, and
    the root mean square distance [m] that remains.

    A constant offset between both is a free parameter: it belongs to the map.
    """

    from scipy.optimize import minimize_scalar

    def misfit(latency: float) -> float:
        errors = along - np.interp(stamps - latency, arm[:, 0], arm[:, 1])
        return float(np.std(errors))

    latencies = np.arange(-most, most + FIRST_STEP / 2, FIRST_STEP)
    start = min(latencies.tolist(), key=misfit)
    bounds = (start - FIRST_STEP, start + FIRST_STEP)
    best = minimize_scalar(
        misfit, bounds=bounds, method="bounded", options={"xatol": 1e-6}
    )
    return float(best.x), float(best.fun)


def _reasons(
    latency: float, apart: float, misfit_mm: float, settings: LatencySettings
) -> tuple[str, ...]:
    """Texts on why a measured `latency` [s] is refused: it is too large, its halves lie
    too far `apart` [s], or images and arm do not agree in motion.
    """
    return reasons(
        (
            abs(latency) > settings.most,
            (
                f"the latency is {1e3 * latency:.0f} ms, plausible up to "
                f"{1e3 * settings.most:.0f} ms; check the clock of the camera's stamps"
            ),
        ),
        (
            apart > settings.uncertainty,
            (
                f"two halves of the images differ by {1e3 * apart:.1f} ms in latency,"
                f" allowed {1e3 * settings.uncertainty:.1f} ms; step again, check that"
                " the frame rate is steady"
            ),
        ),
        (
            misfit_mm > settings.misfit_mm,
            (
                f"image and arm are {misfit_mm:.1f} mm apart in motion, allowed "
                f"{settings.misfit_mm:.1f} mm; fasten the pointer, shorten the exposure"
            ),
        ),
    )
