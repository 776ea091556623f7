"""The map to the plane, by touching: asks for gripper poses, is told images, gives a verdict."""

from dataclasses import dataclass
from math import pi
from typing import Annotated

import numpy as np
from pydantic import Field

from calibration.homography import MINIMUM_POINTS, Homography, Rejected, fit_homography
from calibration.lens import Lens
from calibration.pointer import find_pointer
from drivers.errors import ConfigurationError
from drivers.settings import Settings
from drivers.types import Array, Frame, Pose

Count = Annotated[int, Field(ge=3, le=12)]


class TouchSettings(Settings):
    """Where to touch, how often to look, and what the verdict demands.

    The points lie on a grid of `columns` x `rows` over the work area [m]; every `hold_out`-th
    decides and is not fitted. An image is taken when two in a row agree within `still` [px].
    """

    x_min: float = Field(0.02, ge=-0.5, le=1.0)
    x_max: float = Field(0.60, gt=0, le=2.0)
    z_min: float = Field(0.015, ge=0.0, le=0.2)
    z_max: float = Field(0.30, gt=0, le=1.0)
    columns: Count = 5
    rows: Count = 4
    hold_out: int = Field(4, ge=2, le=10)
    still: float = Field(0.3, gt=0, le=2)
    patience: int = Field(8, ge=2, le=100)  # images at one pose before it is given up
    worst_mm: float = Field(1.0, gt=0, le=10)  # allowed at the held-out points
    rejected: int = Field(2, ge=0, le=10)  # allowed refused points


@dataclass(frozen=True, slots=True)
class TouchVerdict:
    """The map, its rms and worst distance [mm] at points not used in the fit, and why it fails.

    `rejected` names fitted points that disagree; `reasons` is empty when `passed`.
    """

    homography: Homography | None
    residual_mm: float
    worst_mm: float
    used: int
    held_out: int
    rejected: tuple[Rejected, ...]
    reasons: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the map may be used."""
        return self.homography is not None and not self.reasons


@dataclass(frozen=True, slots=True)
class Touched:
    """One point: where the arm was (x, z) [m], where the undistorted image shows it [px]."""

    place: Array
    pixel: Array
    held_out: bool


class TouchedPoints:
    """Ask and tell: the caller moves the pointer to `ask()` and tells what the camera then saw."""

    def __init__(self, lens: Lens, settings: TouchSettings) -> None:
        self._lens = lens
        self._settings = settings
        self._plan = _plan(settings)
        self._at = 0
        self._tries = 0
        self._last: tuple[Array, Array] | None = None
        self._points: list[Touched] = []

    def ask(self) -> Pose | None:
        """Where to bring the pointer next and hold it still; None when there is enough."""
        return self._plan[self._at] if self._at < len(self._plan) else None

    def tell(self, frame: Frame, pose: Pose) -> str | None:
        """An image of the pointer at rest at the measured `pose`; why one more is needed, or None.

        After `patience` images without two that agree the point is given up.
        """
        self._tries += 1
        refused = self._take(frame, pose)
        if refused is None or self._tries >= self._settings.patience:
            self._at += 1
            self._tries = 0
            self._last = None
        return refused

    def verdict(self) -> TouchVerdict:
        """What the points told so far amount to."""
        fitted = [p for p in self._points if not p.held_out]
        decide = [p for p in self._points if p.held_out]
        try:
            fit = fit_homography(
                np.array([p.pixel for p in fitted]), np.array([p.place for p in fitted])
            )
        except ConfigurationError as error:
            nan = float("nan")
            return TouchVerdict(None, nan, nan, 0, len(decide), (), (str(error),))
        errors = _distances_mm(fit.homography, decide)
        worst = float(errors.max(initial=0.0))
        reasons = []
        if len(decide) < 3:
            reasons.append(f"{len(decide)} held-out points, at least 3 must decide; touch more")
        if worst > self._settings.worst_mm:
            reasons.append(
                f"a held-out point is {worst:.2f} mm off, allowed {self._settings.worst_mm:.2f}; "
                "check that the pointer is tight and the camera has not moved"
            )
        if len(fit.rejected) > self._settings.rejected:
            reasons.append("; ".join(str(point) for point in fit.rejected))
        return TouchVerdict(
            homography=fit.homography,
            residual_mm=float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan"),
            worst_mm=worst,
            used=int(fit.used.sum()),
            held_out=len(decide),
            rejected=fit.rejected,
            reasons=tuple(reasons),
        )

    def _take(self, frame: Frame, pose: Pose) -> str | None:
        centre = find_pointer(frame.image)
        if centre is None:
            self._last = None
            return "the pointer's disc is not seen exactly once; uncover it, light it"
        place = np.array([pose.x, pose.z])
        last, self._last = self._last, (centre, place)
        if last is None:
            return "one more image, to see that the pointer is still"
        moved = float(np.hypot(*(centre - last[0])))
        if moved > self._settings.still:
            return f"the pointer moved by {moved:.1f} px between two images; wait until it is still"
        pixel = self._lens.undistort((centre + last[0])[None] / 2)[0]
        held_out = self._at % self._settings.hold_out == self._settings.hold_out // 2
        self._points.append(Touched((place + last[1]) / 2, pixel, held_out))
        return None


def _plan(settings: TouchSettings) -> tuple[Pose, ...]:
    """Poses over the work area, row by row, back and forth; at least twelve to fit."""
    if settings.columns * settings.rows * (1 - 1 / settings.hold_out) < MINIMUM_POINTS:
        raise ConfigurationError(
            f"touch: {settings.columns} x {settings.rows} points with every "
            f"{settings.hold_out}th held out leave too few; at least {MINIMUM_POINTS} are fitted"
        )
    poses: list[Pose] = []
    for i, z in enumerate(np.linspace(settings.z_min, settings.z_max, settings.rows)):
        columns = np.linspace(settings.x_min, settings.x_max, settings.columns)
        poses += [Pose(float(x), float(z), pi / 2) for x in columns[:: 1 if i % 2 == 0 else -1]]
    return tuple(poses)


def _distances_mm(homography: Homography, points: list[Touched]) -> Array:
    if not points:
        return np.empty(0)
    seen = homography.to_plane(np.array([p.pixel for p in points]))
    return np.asarray(1e3 * np.hypot(*(seen - np.array([p.place for p in points])).T))
