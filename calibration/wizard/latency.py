"""Camera latency from steps of the arm: the pointer in images against the arm's positions."""

from dataclasses import dataclass, replace
from math import nan, pi

import numpy as np
from pydantic import Field

from calibration.homography import Homography
from calibration.lens import Lens
from calibration.pointer import find_pointer
from calibration.wizard.verdict import Line, Verdict, grade_line, reasons
from drivers.settings import Settings
from drivers.types import ArmState, Array, Frame, Pose

APART_GRADES = (2.0, 5.0)  # ms between two halves of the images, up to which good, then fair
DRIFT_LOSS_SCALE = 5e-4  # m, error from which an image counts less
DRIFT_SIGMA = 6.0  # sigma by which a drift must differ from zero
MOVING_SPEED = 0.02  # m/s of the pointer from which an image reveals the latency
FIRST_STEP = 0.005  # s between the latencies that are tried first


class LatencySettings(Settings):
    """Settings of the latency measurement and its acceptance criteria.

    The arm makes `steps` moves of `step` [m] along x from (`x`, `z`) and back. `most` is the
    largest plausible latency and `uncertainty` the allowed difference between two halves of the
    images, both [s]; `images` is the number required in motion.
    """

    x: float = Field(0.25, ge=-0.5, le=2.0)
    z: float = Field(0.15, ge=0.02, le=1.0)
    step: float = Field(0.12, ge=0.02, le=0.4)
    steps: int = Field(6, ge=2, le=40)
    images: int = Field(10, ge=4)
    most: float = Field(0.3, gt=0, le=1)
    uncertainty: float = Field(0.005, gt=0, le=0.1)
    misfit_mm: float = Field(2.0, gt=0, le=20)  # rms between image and arm at the best latency


@dataclass(frozen=True, slots=True)
class LatencyVerdict(Verdict):
    """Measured `latency` [s], the time from an exposure to its stamp, and reasons for refusal.

    `apart` [s] is the difference between two halves of the images, `misfit_mm` the rms distance
    between image and arm at the best latency, `images` the number taken in motion.
    """

    latency: float = nan
    apart: float = nan
    misfit_mm: float = nan
    images: int = 0

    def lines(self, speed: float) -> list[Line]:
        """Line on the latency and its effect at `speed` [m/s], or the reasons for refusal."""
        if self.reasons:
            return self.bad_lines()
        late = round(1e3 * self.latency, 1) + 0.0  # never minus nothing
        text = f"images are stamped {late:.1f} ms late, known within {1e3 * self.apart:.1f} ms; "
        text += "the cell corrects it"
        if spared := round(1e3 * abs(self.latency) * speed, 1):
            text += f", which spares an error of {spared:.1f} mm at {speed:.2f} m/s"
        return [grade_line(1e3 * self.apart, *APART_GRADES, text)]


NOT_MEASURED = LatencyVerdict(reasons=("the latency was not measured",))


class LatencySteps:
    """Collection of arm states and images for the latency, by ask and tell.

    The caller moves the arm to the poses of `ask()`.
    """

    def __init__(self, settings: LatencySettings) -> None:
        start = Pose(settings.x, settings.z, pi / 2)
        end = Pose(settings.x + settings.step, settings.z, pi / 2)
        self._queue = [(start, end)[k % 2] for k in range(settings.steps + 1)]
        self._arm: list[tuple[float, float, float]] = []
        self._seen: list[tuple[float, float, float]] = []

    @property
    def left(self) -> int:
        """Number of moves of the arm that the latency measurement still requires."""
        return len(self._queue)

    @property
    def arm(self) -> Array:
        """Measurements (n, 3) of the arm: stamp [s], x, z [m]."""
        return np.reshape(self._arm, (-1, 3))

    @property
    def seen(self) -> Array:
        """Measurements (n, 3) in images of the pointer: stamp [s], centre of its disc u, v [px]."""
        return np.reshape(self._seen, (-1, 3))

    def ask(self) -> Pose | None:
        """Next pose of the calibration pointer; None once all moves are done."""
        return self._queue[0] if self._queue else None

    def record_arrival(self) -> None:
        """Record that the arm is at rest at the requested pose."""
        self._queue = self._queue[1:]

    def tell_arm(self, state: ArmState) -> None:
        """Add the arm's newest `state`, unless the same state was added before."""
        if not self._arm or state.stamp > self._arm[-1][0]:
            self._arm.append((state.stamp, state.pose.x, state.pose.z))

    def tell_frame(self, frame: Frame) -> None:
        """Add a new image; ignored where the image does not show the pointer."""
        centre = find_pointer(frame.image)
        if centre is not None:
            self._seen.append((frame.stamp, float(centre[0]), float(centre[1])))


def latency_verdict(
    arm: Array, seen: Array, lens: Lens, homography: Homography, settings: LatencySettings
) -> LatencyVerdict:
    """Measure the camera's latency by stamped places of the arm (n, 3), in images `seen` (m, 3).

    `arm` holds stamp [s], x, z [m], `seen` stamp [s], u, v [px] of the pointer; `homography` is
    that of the touched points.
    """
    if len(arm) < 2 or len(seen) == 0:
        return LatencyVerdict(reasons=("no step of the arm was seen; step again",))
    inside = (seen[:, 0] > arm[0, 0] + settings.most) & (seen[:, 0] < arm[-1, 0])
    stamps = seen[inside, 0]
    along = homography.to_plane(lens.undistort(seen[:, 1:]))[inside, 0]
    speed = np.interp(stamps, arm[:, 0], np.abs(np.gradient(arm[:, 1], arm[:, 0])))
    moving = int((speed > MOVING_SPEED).sum())
    if moving < settings.images:
        reason = f"{moving} images show the pointer under way, {settings.images} are needed"
        return LatencyVerdict(images=moving, reasons=(f"{reason}; step again, uncover it",))
    latency, misfit = _best_latency(arm, stamps, along, settings.most)
    one, other = (_best_latency(arm, stamps[k::2], along[k::2], settings.most)[0] for k in (0, 1))
    verdict = LatencyVerdict(
        latency=latency, apart=abs(one - other), misfit_mm=1e3 * misfit, images=moving
    )
    drift = _drift_reasons(arm, stamps, along, latency, settings)
    return replace(verdict, reasons=drift or _reasons(verdict, settings))


def _drift_reasons(
    arm: Array, stamps: Array, along: Array, latency: float, settings: LatencySettings
) -> tuple[str, ...]:
    """Reason for refusal where the latency drifts over the steps: two clocks of unequal rate."""
    rate, rate_sigma = _drift_rate(arm, stamps, along, latency)
    duration = float(np.ptp(stamps))
    drift = rate * duration
    if abs(drift) <= settings.uncertainty or abs(rate) < DRIFT_SIGMA * rate_sigma:
        return ()
    return (
        f"the camera's stamps drift against the arm's, by {1e3 * drift:+.0f} ms over "
        f"{duration:.0f} s (allowed {1e3 * settings.uncertainty:.0f} ms): the two do not run by "
        "one clock; stamp images by the machine's monotonic clock",
    )


def _drift_rate(arm: Array, stamps: Array, along: Array, latency: float) -> tuple[float, float]:
    """Drift of the latency [s/s] and one sigma of it, by a robust fit that begins at `latency`."""
    from scipy.optimize import least_squares

    since = stamps - stamps.mean()

    def errors(unknown: Array) -> Array:
        late, rate, offset = unknown
        exposures = stamps - (late + rate * since)
        return np.asarray(along - np.interp(exposures, arm[:, 0], arm[:, 1]) - offset)

    fit = least_squares(
        errors, (latency, 0.0, 0.0), loss="cauchy", f_scale=DRIFT_LOSS_SCALE, x_scale="jac"
    )
    noise = np.mean(errors(fit.x) ** 2)
    sigma = np.sqrt(noise * np.linalg.pinv(fit.jac.T @ fit.jac)[1, 1])
    return float(fit.x[1]), float(sigma)


def _best_latency(arm: Array, stamps: Array, along: Array, most: float) -> tuple[float, float]:
    """Latency [s] at which images and arm agree best, and their remaining rms distance [m].

    A constant offset between both is a free parameter: it belongs to the map.
    """

    from scipy.optimize import minimize_scalar

    def misfit(latency: float) -> float:
        errors = along - np.interp(stamps - latency, arm[:, 0], arm[:, 1])
        return float(np.std(errors))

    latencies = np.arange(-most, most + FIRST_STEP / 2, FIRST_STEP)
    start = float(latencies[np.argmin([misfit(latency) for latency in latencies])])
    bounds = (start - FIRST_STEP, start + FIRST_STEP)
    best = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-6})
    return float(best.x), float(best.fun)


def _reasons(verdict: LatencyVerdict, settings: LatencySettings) -> tuple[str, ...]:
    """Texts of the acceptance criteria that `verdict` does not meet."""
    return reasons(
        (abs(verdict.latency) > settings.most,
         f"the latency is {1e3 * verdict.latency:.0f} ms, plausible up to "
         f"{1e3 * settings.most:.0f} ms; check the clock of the camera's stamps"),
        (verdict.apart > settings.uncertainty,
         f"two halves of the images differ by {1e3 * verdict.apart:.1f} ms in latency, allowed "
         f"{1e3 * settings.uncertainty:.1f} ms; step again, check that the frame rate is steady"),
        (verdict.misfit_mm > settings.misfit_mm,
         f"image and arm are {verdict.misfit_mm:.1f} mm apart in motion, allowed "
         f"{settings.misfit_mm:.1f} mm; fasten the pointer, shorten the exposure"),
    )  # fmt: skip
