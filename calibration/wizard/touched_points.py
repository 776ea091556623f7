"""Calibration of the map to the plane by touched points: requests poses, judges
images.
"""

from collections.abc import Sequence

import numpy as np

from calibration.board import find_pointer
from calibration.homography import map_deviation
from calibration.lens import Lens
from calibration.wizard.progress import (
    Mark,
    MarkKind,
    Progress,
    SessionRow,
    position_text,
)
from calibration.wizard.touch_verdict import TouchVerdict, touch_verdict
from calibration.wizard.touches import (
    TouchedPoint,
    TouchSettings,
    held_out,
    require_enough,
    suspects,
    touch_plan,
)
from drivers.base.errors import ConfigurationError
from drivers.base.geometry import lengths
from drivers.base.types import Array, Frame, Image, Pose

TITLE = "the map to the plane"
NOT_STILL = "between two images; wait until it is still"


class TouchedPoints:
    """Collection of points that the arm touches for a map from the image to the plane:
    it asks for one pose after another, and is told the camera's images.

    The caller moves the pointer to `ask()` and passes the camera's image to `tell()`.
    After all poses, those of the map's outliers are requested once more.
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
        """Collect touches on the grid that `settings` state or, where a `plan` is
        given, at its poses.

        Points that are not `fitted` may be few, and each is touched once. Raises
        ConfigurationError for a plan with too few points to fit a map.
        """
        self.lens = lens
        self._settings = settings
        self.plan = touch_plan(settings) if plan is None else tuple(plan)
        self.fitted = fitted
        if fitted:
            require_enough(self.plan, settings)

        # by number, and whether again
        self._touches: dict[tuple[int, bool], TouchedPoint] = {}
        self._queue = [(number, False) for number in range(len(self.plan))]
        self._repeats = fitted
        self._tries = 0
        self._last: tuple[Array, Array] | None = None

    @property
    def touches(self) -> tuple[TouchedPoint, ...]:
        """All accepted touches, in the order in which they were made."""
        return tuple(self._touches.values())

    @property
    def number(self) -> int | None:
        """Number of the pose that is to be touched next; None once there are enough
        points.
        """
        return self._queue[0][0] if self._queue else None

    @property
    def again(self) -> bool:
        """Whether the pose that is to be touched next was touched before, and disagreed
        with the others.
        """
        return bool(self._queue) and self._queue[0][1]

    def ask(self) -> Pose | None:
        """Next pose in which the arm is to hold the pointer still; None once there are
        enough points.

        After the planned ones, those that disagree with the others are asked once more.
        """
        if not self._queue and self._repeats:
            self._repeats = False
            outliers = suspects(self.touches, self.lens, self._settings)
            self._queue = [(number, True) for number in outliers]
        return self.plan[self._queue[0][0]] if self._queue else None

    def tell(self, frame: Frame, pose: Pose) -> SessionRow:
        """Process an image of the pointer, which rests while the arm measures its
        `pose`, and return what was found.

        After `patience` images without two that agree the point is given up. Raises
        ConfigurationError for an image of another size than the lens was calibrated
        with.
        """
        self._check_size(frame)
        self._tries += 1
        centre = find_pointer(frame.image)
        refused = self._refuse(centre, np.array([pose.x, pose.z]))
        taken = refused is None and self._last is not None
        self._last = None if centre is None else (centre, np.array([pose.x, pose.z]))
        number, again = self._queue[0]
        row = SessionRow(
            number=number,
            refused=refused,
            centre=None if centre is None else tuple(centre.tolist()),
            pose=tuple(pose),
            again=taken and again,
            taken=taken,
        )
        if centre is not None and taken:
            self._accept(row, centre)
        if taken or self._tries >= self._settings.patience:
            self.skip()

        return row

    def restore(self, row: SessionRow, image: Image) -> bool:
        """Accept again the point of a session's `row` if its `image`, of shape (height,
        width, 3), shows the pointer, and return whether it does.

        Raises ConfigurationError for a row without a pose.
        """
        centre = find_pointer(image)
        if centre is None:
            return False
        self._accept(row, centre)
        self._queue = [touch for touch in self._queue if touch[0] != row.number]
        return True

    def skip(self) -> None:
        """Give up the pose that is to be touched next, so that the one after it is
        asked for.
        """
        self._queue = self._queue[1:]
        self._tries = 0
        self._last = None

    def take_back(self) -> SessionRow | None:
        """Remove the newest touch, so that it is asked for again; returns the row to
        note this in the session, or None where there is no touch.
        """
        if not self._touches:
            return None
        (number, again), _ = self._touches.popitem()
        self._queue = [(number, again), *self._queue]
        self._tries = 0
        self._last = None
        return SessionRow(number=number, again=again, dropped=True)

    def verdict(self) -> TouchVerdict:
        """Verdict on the map from the image to the plane that fits all points touched
        until now.
        """
        return touch_verdict(self.touches, self.lens, self._settings)

    @property
    def why(self) -> str:
        """Text on why the next pose is asked for, with the number of points that are
        touched.
        """
        number = self.number
        if self.again:
            return f"point {number} disagrees with the others: touch it once more"
        done = f"{len(self._touches)} of {len(self.plan)} points are touched"
        if number is None or not self.fitted:
            return done
        held = held_out(number, self._settings)
        return (
            f"point {number} ({'held out for the verdict' if held else 'fitted'}):"
            f" {done}"
        )

    def progress(
        self, frame: Frame | None = None, result: SessionRow | None = None
    ) -> Progress:
        """Message to observers with the next pose, the plan of poses and, where given,
        the `result` of the newest image `frame`.
        """
        wanted = self.ask()
        plan = [
            (pose.x, pose.z, self._state(number))
            for number, pose in enumerate(self.plan)
        ]
        return Progress(
            title=f"{TITLE}: {'touch again' if self.again else 'touch'}",
            request="nothing" if wanted is None else request_text(wanted),
            why=self.why,
            frame=frame,
            result=result,
            marks=self.marks(TouchVerdict()),
            plan=tuple(plan),
        )

    def marks(self, verdict: TouchVerdict) -> tuple[Mark, ...]:
        """Marks to be drawn at all touched points, with their errors by the map of
        `verdict`; points that do not agree with it have a mark of their own.
        """
        marks = []
        for point in self.touches:
            kind = MarkKind.HELD_OUT if point.held_out else MarkKind.FITTED
            error = self._error(point, verdict)
            replaced = point.number in verdict.wild and not point.again
            if replaced or point.number in verdict.rejected:
                kind = MarkKind.WILD
                error = None
            marks.append(
                Mark(pixel=point.pixel, kind=kind, label=str(point.number), error=error)
            )
        return tuple(marks)

    def deviation(self, verdict: TouchVerdict, pixels: Array) -> Array:
        """Standard deviations [m] of shape (k,) with which the map of `verdict` is
        known at the image points `pixels` of shape (k, 2); NaN where it has no map.
        """
        plane_map = verdict.plane_map
        if plane_map is None:
            return np.full(len(pixels), np.nan)
        replaced = verdict.rejected.keys() | verdict.wild.keys()
        fitted = [
            point
            for point in self.touches
            if not point.held_out and (point.again or point.number not in replaced)
        ]
        seen = plane_map.lens.undistort(np.array([point.pixel for point in fitted]))
        positions = np.array([point.position for point in fitted])
        return map_deviation(
            plane_map.homography, seen, positions, plane_map.to_plane(pixels)
        )

    def _error(self, point: TouchedPoint, verdict: TouchVerdict) -> Array | None:
        """Error of a point in the image [px], along both axes, by the map of `verdict`;
        None where it has no map.
        """
        if verdict.plane_map is None:
            return None
        error: Array = point.pixel - verdict.plane_map.to_image(point.position)[0]
        return error

    def _state(self, number: int) -> str:
        """Character that shows the state of the planned pose `number`: asked for now,
        to come, fitted, held out of the fit, or touched twice.
        """
        if number == self.number:
            return ">"
        if (number, True) in self._touches:
            return "x"
        point = self._touches.get((number, False))
        return "." if point is None else "h" if point.held_out else "o"

    def _check_size(self, frame: Frame) -> None:
        """Raise ConfigurationError for an image of another size than the lens was found
        with.
        """
        lens = self.lens
        if not lens.fits(frame.image):
            height, width = frame.image.shape[:2]
            raise ConfigurationError(
                f"touch: the image is {width} x {height} px, the lens was found with"
                f" {lens.width} x {lens.height} px; set the camera to that"
                " size, or run `cell calibrate camera` at this one"
            )

    def _refuse(self, centre: Array | None, position: Array) -> str | None:
        """Text on why an image is refused that shows the pointer at `centre` [px] while
        the arm is at `position` [m]; None where there is no reason.
        """
        if centre is None:
            return "the pointer's disc is not seen exactly once; uncover it, light it"
        if self._last is None:
            return None

        last_centre, last_position = self._last
        arm_moved = lengths(position - last_position)
        if arm_moved > self._settings.arm_still:
            return f"the arm moved by {1e3 * arm_moved:.1f} mm {NOT_STILL}"

        moved = lengths(centre - last_centre)
        if moved > self._settings.still:
            return f"the pointer moved by {moved:.1f} px {NOT_STILL}"

        return None

    def _accept(self, row: SessionRow, centre: Array) -> None:
        """Store the touch of the session's `row`, whose image shows the pointer's disc
        at `centre` [px].
        """
        number = row.number
        if row.pose is None:
            raise ConfigurationError(
                f"told.jsonl: point {number} has no pose; leave it out"
            )
        self._touches.pop((number, row.again), None)  # the newest is the last
        self._touches[number, row.again] = TouchedPoint(
            number=number,
            position=np.array(row.pose[:2]),
            pixel=centre,
            held_out=held_out(number, self._settings),
            again=row.again,
        )


def request_text(pose: Pose) -> str:
    """Text that asks for the next `pose` of the arm."""
    return f"the arm goes to {position_text(pose.x, pose.z)}"
