"""Calibration of the map to the plane by touched points: requests poses, judges images."""

from collections.abc import Iterable, Sequence

import numpy as np

from calibration.lens import Lens
from calibration.pointer import find_pointer
from calibration.wizard.progress import Mark, MarkKind, PlannedPoint, Progress, Result, Row
from calibration.wizard.touch_verdict import TouchVerdict, touch_verdict
from calibration.wizard.touches import (
    Touch,
    TouchSettings,
    held_out,
    require_enough,
    suspects,
    touch_plan,
)
from drivers.errors import ConfigurationError
from drivers.types import Array, Frame, Image, Pose

NOT_STILL = "between two images; wait until it is still"


class TouchedPoints:
    """Collection of touched points, by ask and tell.

    The caller moves the pointer to `ask()` and passes the camera's image to `tell()`. After all
    poses, those of the map's outliers are requested once more; `again` is set meanwhile.
    """

    subject = "pointer"

    def __init__(
        self,
        lens: Lens,
        settings: TouchSettings,
        plan: Sequence[Pose] | None = None,
        *,
        fitted: bool = True,
    ) -> None:
        """Collect touches on the grid of `settings`, or at the poses of a `plan`.

        Points that are not `fitted` may be few, and each is touched once. Raises ConfigurationError
        for a plan with too few points to fit a map.
        """
        self.lens = lens
        self._settings = settings
        self.plan = touch_plan(settings) if plan is None else tuple(plan)
        self.fitted = fitted
        if fitted:
            require_enough(self.plan, settings)
        self._touches: list[Touch] = []
        self._queue = list(range(len(self.plan)))
        self.again = False
        self._tries = 0
        self._last: tuple[Array, Array] | None = None

    @property
    def touches(self) -> tuple[Touch, ...]:
        """All accepted touches, in the order in which they were made."""
        return tuple(self._touches)

    @property
    def number(self) -> int | None:
        """Number of the pose to touch next; None once there are enough points."""
        return self._queue[0] if self._queue else None

    def ask(self) -> Pose | None:
        """Next pose for the pointer, to be held still; None once there are enough points."""
        return self.plan[self._queue[0]] if self._queue else None

    def tell(self, frame: Frame, pose: Pose) -> Result:
        """Process an image of the pointer at rest at the measured `pose`.

        After `patience` images without two that agree the point is given up. Raises
        ConfigurationError for an image of another size than the lens was calibrated with.
        """
        self._check_size(frame)
        self._tries += 1
        centre = find_pointer(frame.image)
        refused = self._refuse(centre, np.array([pose.x, pose.z]))
        taken = refused is None and self._last is not None
        self._last = None if centre is None else (centre, np.array([pose.x, pose.z]))
        row = Row(
            number=self._queue[0],
            refused=refused,
            pose=(pose.x, pose.z, pose.pitch),
            again=taken and self.again,
        )
        if centre is not None:
            row = row.model_copy(update={"centre": tuple(centre.tolist())})
        if centre is not None and taken:
            self._touches.append(self._touched(row, centre))
        given_up = not taken and self._tries >= self._settings.patience
        if taken or given_up:
            self.skip()
        return Result(row, taken, given_up)

    def restore(self, rows: Iterable[tuple[Row, Image]]) -> Row | None:
        """Accept the points in a session's images (h, w, 3); returns a row without one, or None.

        Raises ConfigurationError for a row without a pose.
        """
        latest: dict[tuple[int, bool], Touch] = {}
        for row, image in rows:
            centre = find_pointer(image)
            if centre is None:
                return row
            latest[row.number, row.again] = self._touched(row, centre)
        self._touches = [*latest.values()]
        touched = {number for number, _ in latest}
        self._queue = [number for number in self._queue if number not in touched]
        self._repeat_suspects()
        return None

    def skip(self) -> None:
        """Give up the pose that is to be touched next."""
        self._queue = self._queue[1:]
        self._tries = 0
        self._last = None
        self._repeat_suspects()

    def take_back(self) -> Row | None:
        """Remove the newest touch and request it again; returns its row, None if there is none."""
        if not self._touches:
            return None
        dropped = self._touches.pop()
        self._queue = [dropped.number, *self._queue]
        self._tries = 0
        self._last = None
        return Row(number=dropped.number, again=dropped.again, dropped=True)

    def verdict(self) -> TouchVerdict:
        """Verdict on the map from the points touched until now."""
        return touch_verdict(self._touches, self.lens, self._settings)

    @property
    def why(self) -> str:
        """Reason for the requested pose, and the number of touched points."""
        if self.again:
            return f"point {self.number} disagrees with the others: touch it once more"
        done = f"{len(self._touches)} of {len(self.plan)} points are touched"
        held = self.number is not None and held_out(self.number, self._settings)
        part = "held out for the verdict" if held else "fitted"
        return f"point {self.number} ({part}): {done}" if self.fitted else done

    def progress(self, wanted: Pose | None, why: str, stage: str) -> Progress:
        """Message for displays: the arm's next pose, `why` it is wanted, state of each planned one.

        `stage` names what the calibration does now, for the operator.
        """
        touched = {point.number: point for point in self._touches}
        plan = []
        for number, pose in enumerate(self.plan):
            state = ">" if pose == wanted else _state(touched.get(number))
            plan.append(PlannedPoint(pose.x, pose.z, state))
        return Progress(
            title=f"the map to the plane: {stage}",
            request="nothing" if wanted is None else f"the arm goes to {_place(wanted)}",
            why=why,
            marks=tuple(
                Mark(point.pixel, _kind(point), str(point.number)) for point in self._touches
            ),
            plan=tuple(plan),
        )

    def answer(self, result: Result, pose: Pose) -> str:
        """Text on the `result` of an image taken at `pose`; empty while the next is awaited."""
        again = " again" if result.row.again else ""
        return result.text("point", f"touched{again} at {_place(pose)}")

    def marks(self, verdict: TouchVerdict) -> tuple[Mark, ...]:
        """Marks of all points with their errors by the map of `verdict`, and of outliers."""
        marks = []
        for point in self._touches:
            label = str(point.number)
            replaced = point.number in verdict.wild and not point.again
            if replaced or point.number in verdict.rejected:
                marks.append(Mark(point.pixel, MarkKind.WILD, label))
            else:
                marks.append(Mark(point.pixel, _kind(point), label, self._error(point, verdict)))
        return tuple(marks)

    def _error(self, point: Touch, verdict: TouchVerdict) -> Array | None:
        """Error (2,) [px] of a point in the image by the verdict's map; None without a map."""
        if verdict.homography is None:
            return None
        mapped = self.lens.distort(verdict.homography.to_image(point.place))[0]
        return np.asarray(point.pixel - mapped)

    def _repeat_suspects(self) -> None:
        """Once all poses are touched, request those of the map's outliers a second time."""
        if not self._queue and self.fitted and not self.again:
            self.again = True
            self._queue = list(suspects(self._touches, self.lens, self._settings))

    def _check_size(self, frame: Frame) -> None:
        """Raise ConfigurationError for an image of another size than the lens was found with."""
        if not self.lens.fits(frame.image):
            height, width = frame.image.shape[:2]
            raise ConfigurationError(
                f"touch: the image is {width} x {height} px, the lens was found with "
                f"{self.lens.width} x {self.lens.height} px; set the camera to that size, "
                "or run `cell calibrate camera` at this one"
            )

    def _refuse(self, centre: Array | None, place: Array) -> str | None:
        """Reason to refuse an image that shows the pointer at `centre` [px], the arm at `place`."""
        if centre is None:
            return "the pointer's disc is not seen exactly once; uncover it, light it"
        if self._last is None:
            return None
        last_centre, last_place = self._last
        arm_moved = np.hypot(*(place - last_place))
        if arm_moved > self._settings.arm_still:
            return f"the arm moved by {1e3 * arm_moved:.1f} mm {NOT_STILL}"
        moved = np.hypot(*(centre - last_centre))
        if moved > self._settings.still:
            return f"the pointer moved by {moved:.1f} px {NOT_STILL}"
        return None

    def _touched(self, row: Row, centre: Array) -> Touch:
        """Touch that `row` describes, whose image shows the pointer at `centre` (2,) [px]."""
        if row.pose is None:
            raise ConfigurationError(f"told.jsonl: point {row.number} has no pose; leave it out")
        return Touch(
            number=row.number,
            place=np.array(row.pose[:2]),
            pixel=centre,
            held_out=held_out(row.number, self._settings),
            again=row.again,
        )


def _kind(point: Touch) -> MarkKind:
    return MarkKind.HELD_OUT if point.held_out else MarkKind.FITTED


def _state(point: Touch | None) -> str:
    """Character of a planned pose in the terminal: to come, accepted, held out or to repeat."""
    if point is None:
        return "."
    if point.again:
        return "x"
    return "h" if point.held_out else "o"


def _place(pose: Pose) -> str:
    return f"x {1e3 * pose.x:.0f}, z {1e3 * pose.z:.0f} mm"
