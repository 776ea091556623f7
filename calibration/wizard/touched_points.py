"""Map to the plane by touching, by ask and tell: requests gripper poses, judges images."""

from collections.abc import Sequence

import numpy as np

from calibration.lens import Lens
from calibration.pointer import find_pointer
from calibration.wizard.news import Result, TouchResult
from calibration.wizard.touch_verdict import TouchVerdict, touch_verdict
from calibration.wizard.touches import (
    BegunPlan,
    Touched,
    TouchSettings,
    checked_plan,
    held_out,
    suspects,
    touch_plan,
)
from drivers.errors import ConfigurationError
from drivers.types import Array, Frame, Pose


class TouchedPoints:
    """Collects touched points by ask and tell: the caller moves the pointer to `ask()` and passes
    the camera's image to `tell()`.

    After all poses, those of the map's outliers are requested once more.
    """

    def __init__(
        self,
        lens: Lens,
        settings: TouchSettings,
        plan: Sequence[Pose] | None = None,
        *,
        fitted: bool = True,
    ) -> None:
        """Touch the grid of `settings`, or the poses of a `plan`: an edited or a resumed one.

        Points that are not `fitted` may be few, and each is touched once.
        """
        self._lens = lens
        self._settings = settings
        planned = touch_plan(settings) if plan is None else plan
        self._plan = checked_plan(planned, settings) if fitted else tuple(planned)
        self._touches = list(plan.touched) if isinstance(plan, BegunPlan) else []
        done = {point.number for point in self._touches}
        self._queue = [number for number in range(len(self._plan)) if number not in done]
        self._fitted, self._second = fitted, False
        self._tries = 0
        self._last: tuple[Array, Array] | None = None
        self._repeat_suspects()

    @property
    def plan(self) -> tuple[Pose, ...]:
        """All planned poses, by number."""
        return self._plan

    @property
    def touches(self) -> tuple[Touched, ...]:
        """All accepted points, in the order in which they were touched."""
        return tuple(self._touches)

    @property
    def number(self) -> int | None:
        """Number of the requested pose, None when there are enough points."""
        return self._queue[0] if self._queue else None

    @property
    def held_out(self) -> bool:
        """Whether the requested pose is held out of the fit."""
        return bool(self._queue) and held_out(self._queue[0], self._settings)

    @property
    def fitted(self) -> bool:
        """Whether a map is fitted to the points, rather than checked with them."""
        return self._fitted

    @property
    def again(self) -> bool:
        """Whether points that disagreed are being touched a second time."""
        return self._second

    def ask(self) -> Pose | None:
        """The next pose for the pointer, to be held still; None once there are enough points."""
        return self._plan[self._queue[0]] if self._queue else None

    def tell(self, frame: Frame, pose: Pose) -> TouchResult:
        """Process an image of the pointer at rest at the measured `pose`.

        After `patience` images without two that agree the point is given up. Raises
        ConfigurationError for an image of another size than the lens was calibrated with.
        """
        self._check_size(frame)
        self._tries += 1
        result = self._accept(self._queue[0], frame, pose)
        if result.taken is not None or self._tries >= self._settings.patience:
            self.skip()
        return result

    def skip(self) -> None:
        """Give up the requested pose."""
        self._queue = self._queue[1:]
        self._tries, self._last = 0, None
        self._repeat_suspects()

    def repeat(self) -> Touched | None:
        """Request the previous point again; its touch is dropped and returned, None without one."""
        if not self._touches:
            return None
        dropped = self._touches.pop()
        self._queue = [dropped.number, *self._queue]
        self._tries, self._last = 0, None
        return dropped

    def verdict(self) -> TouchVerdict:
        """The verdict on the touched points so far."""
        return touch_verdict(self._touches, self._lens, self._settings)

    def _repeat_suspects(self) -> None:
        """Once all poses are touched, request those of the map's outliers a second time."""
        if not self._queue and self._fitted and not self._second:
            self._second = True
            self._queue = list(suspects(self._touches, self._lens, self._settings))

    def _check_size(self, frame: Frame) -> None:
        size = (frame.image.shape[1], frame.image.shape[0])
        if size != (self._lens.width, self._lens.height):
            raise ConfigurationError(
                f"touch: the image is {size[0]} x {size[1]} px, the lens was found with "
                f"{self._lens.width} x {self._lens.height} px; set the camera to that size, "
                "or run `cell calibrate camera` at this one"
            )

    def _accept(self, number: int, frame: Frame, pose: Pose) -> TouchResult:
        """Result of an image: accepted if it agrees with the previous one in pixel and pose."""
        centre = find_pointer(frame.image)
        if centre is None:
            self._last = None
            reason = "the pointer's disc is not seen exactly once; uncover it, light it"
            return Result(number, None, None, reason)
        place = np.array([pose.x, pose.z])
        last, self._last = self._last, (centre, place)
        if last is None:
            return Result(number, centre, None, None, waits=True)
        last_centre, last_place = last
        arm_moved = np.hypot(*(place - last_place))
        if arm_moved > self._settings.arm_still:
            reason = f"the arm moved by {1e3 * arm_moved:.1f} mm between two images"
            return Result(number, centre, None, f"{reason}; wait until it is still")
        moved = np.hypot(*(centre - last_centre))
        if moved > self._settings.still:
            reason = f"the pointer moved by {moved:.1f} px between two images"
            return Result(number, centre, None, f"{reason}; wait until it is still")
        touched = Touched(
            number, place, centre, held_out(number, self._settings), again=self._second
        )
        self._touches.append(touched)
        return Result(number, centre, touched, None)
