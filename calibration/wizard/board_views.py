"""Lens calibration from views of a board, by ask and tell: requests views, judges
images.
"""

import cv2
import numpy as np

from calibration.board import BoardDetection, BoardSettings, BoardView, find_board
from calibration.lens import MINIMUM_VIEWS
from calibration.wizard import coverage
from calibration.wizard.coverage import Placement, Sketch, WantedView, guessed_lens
from calibration.wizard.lens_verdict import LensVerdict, fit_views, lens_verdict
from calibration.wizard.progress import Mark, Progress, SessionRow
from drivers.base.types import Frame, Image

# from which a lens is fitted, to compute the board's tilt
FEWEST_VIEWS = max(4, MINIMUM_VIEWS)
# x, y, relative size and rad, from the wanted view
VIEW_TOLERANCE = (0.12, 0.12, 0.25, 0.25)


class BoardViews:
    """Collection of views of the calibration board for the calibration of a lens: it
    asks for one view after another, and is told the camera's images.

    The caller shows the board as `ask()` requests and passes the camera's image to
    `tell()`. Other views count as well. A requested view is given up after `patience`
    refused images; a person (`patient`) calls `skip` instead. `size` are width and
    height [px] of the images.
    """

    subject = "board"

    def __init__(
        self, settings: BoardSettings, size: tuple[int, int], *, patient: bool = False
    ) -> None:
        self._settings = settings
        self._board = settings.board()
        self._detector = cv2.aruco.CharucoDetector(self._board)
        self._requests = list(coverage.wanted_views(settings.lean, settings.sizes))
        self._patience = None if patient else settings.patience
        self._tries = 0
        self._count = 0
        # the previous image's, if it was not refused
        self._last: BoardView | None = None
        self._seen: BoardView | None = None  # the newest image's
        self._views: dict[int, BoardView] = {}
        self._met: dict[int, list[WantedView]] = {}  # the requests that each view met
        self._size = size
        self._lens = guessed_lens(size)

    def ask(self) -> WantedView | None:
        """Next view of the board that is to be shown to the camera; None once the
        accepted views suffice.
        """
        met = [wanted for views in self._met.values() for wanted in views]
        return next((wanted for wanted in self._requests if wanted not in met), None)

    def tell(self, frame: Frame) -> SessionRow:
        """Process an image of the board, and return what was found; a view is accepted
        where two successive images agree.
        """
        number = self._count
        self._count += 1
        look = find_board(frame.image, self._detector, self._board)
        refused = self._refuse(frame, look)
        view = look.view if refused is None else None
        last = self._last
        self._last = view
        self._seen = look.view
        if view is not None and last is not None:
            moved = view.distance(last)
            if moved <= self._settings.still:
                self._accept(number, view)
                return _row(number, view, taken=True)
            refused = (
                f"the board moved by {moved:.1f} px between two images; hold it still"
            )

        self._tries += refused is not None
        if self._patience is not None and self._tries >= self._patience:
            self.skip()

        return _row(number, look.view, refused)

    def restore(self, row: SessionRow, image: Image) -> bool:
        """Accept again the view of a session's `row` if its `image`, of shape (height,
        width, 3), shows the board, and return whether it does.
        """
        view = find_board(image, self._detector, self._board).view
        if view is None:
            return False
        self._accept(row.number, view)
        self._count = max(self._count, row.number + 1)
        return True

    def skip(self) -> None:
        """Give up the view of the board that is asked for now, so that the next one is
        asked for.
        """
        given_up = self.ask()
        self._requests = [wanted for wanted in self._requests if wanted != given_up]
        self._tries = 0
        self._last = None

    def take_back(self) -> SessionRow | None:
        """Remove the newest accepted view, so that it is asked for again; returns the
        row to note this in the session, or None where there is no view.
        """
        newest = max(self._views, default=None)
        if newest is None:
            return None
        del self._views[newest], self._met[newest]
        return SessionRow(number=newest, dropped=True)

    @property
    def views(self) -> tuple[BoardView, ...]:
        """All accepted views of the board, in the order in which they were taken."""
        return tuple(self._views.values())

    @property
    def marks(self) -> tuple[Mark, ...]:
        """Marks to be drawn on all corners of the accepted views, which show how much
        of the image they cover.
        """
        return tuple(Mark(corner) for view in self.views for corner in view.image)

    def progress(
        self, frame: Frame | None = None, result: SessionRow | None = None
    ) -> Progress:
        """Message to observers with the next request, the coverage of the image and,
        where given, the `result` of the newest image `frame`.
        """
        gates = coverage.gates(self.views, self._lens, self._settings)
        wanted = self.ask()
        missing = [gate for gate in gates if not gate.passed]
        seen = () if self._seen is None or result is None else self._seen.image
        return Progress(
            title="the lens, from a board",
            request=(
                "nothing: all is covered"
                if wanted is None
                else f"show the board {wanted}"
            ),
            why=(
                f"still missing: {missing[0]}"
                if missing
                else "all is covered; for good measure"
            ),
            frame=frame,
            result=result,
            marks=tuple(map(Mark, seen)),
            coverage=gates,
            sketch=self._sketch(wanted),
        )

    def verdict(self, length: float | None) -> LensVerdict:
        """Verdict on the lens that fits all views accepted until now.

        `length` [m] is the ruler's length of the board's squares across all columns.
        """
        return lens_verdict(self._views, self._size, length, self._settings)

    def _sketch(self, wanted: WantedView | None) -> Sketch:
        """Outlines of the board in the image [px]: where it is asked for, and where it
        was seen last.
        """
        outline = self._settings.outline()
        as_wanted = as_seen = None
        if wanted is not None:
            as_wanted = wanted.outline(outline, self._lens)
        if self._seen is not None and len(self._seen.ids) >= self._settings.corners:
            as_seen = coverage.project_outline(self._seen, outline)
        return Sketch(self._size, as_wanted, as_seen)

    def _refuse(self, frame: Frame, look: BoardDetection) -> str | None:
        """Reason why an image shows no usable view of the board, as a text; None for a
        usable one.
        """
        settings = self._settings
        height, width, _ = frame.image.shape
        size = (width, height)
        if size != self._size:
            expected = "{} x {} px".format(*self._size)
            return (
                f"the image is {width} x {height} px, the others are {expected};"
                " set the camera back"
            )
        if look.view is None or look.corners < settings.corners:
            return self._why_undetected(look, size)
        if look.side < settings.smallest:
            return (
                f"the board is too far: its markers are {look.side:.0f} px, at least "
                f"{settings.smallest:.0f} px are needed; come nearer"
            )

        distances = (look.view.distance(taken) for taken in self.views)
        nearest = min(distances, default=np.inf)
        if nearest < settings.distinct:
            return (
                f"a view that differs by only {nearest:.0f} px was taken before; move"
                " the board"
            )

        return None

    def _why_undetected(self, look: BoardDetection, size: tuple[int, int]) -> str:
        """Text on why too few corners of the board are found: the board is too close,
        too far, or not in the image.
        """
        side = look.side
        settings = self._settings
        need = (
            f"{look.corners} corners of the board are seen, {settings.corners} are"
            " needed"
        )
        width = side * settings.columns * settings.square / settings.marker
        if look.markers and width > size[0]:
            return f"{need}; the board is too close, it fills {width:.0f} px; go back"
        if look.markers and side < settings.smallest:
            return (
                f"{need}; the board is too far, its markers are {side:.0f} px;"
                " come nearer"
            )

        return f"{need}; bring it into the image, light it, uncover it"

    def _accept(self, number: int, view: BoardView) -> None:
        """Store the accepted `view` of image number `number`, fit the lens again, and
        note which of the required views it meets.
        """
        self._views[number] = view
        self._last = None
        self._tries = 0
        lens = guessed_lens(self._size)
        if len(self._views) >= FEWEST_VIEWS:
            lens = fit_views(self.views, self._size).lens

        self._lens = lens
        shown = coverage.placement(view, self._settings.outline(), lens)
        width = lens.matrix[0, 0] * self._settings.width / view.depth(lens) / lens.width
        self._met[number] = [
            wanted for wanted in self._requests if _matches(wanted, shown, width)
        ]


def _row(
    number: int,
    view: BoardView | None,
    refused: str | None = None,
    *,
    taken: bool = False,
) -> SessionRow:
    """Row for the log of a session on image `number`: the corners in its `view`, and
    the reason in `refused` where it was refused.
    """
    corners = [] if view is None else zip(view.ids, view.image, strict=True)
    numbered = tuple((int(corner), float(u), float(v)) for corner, (u, v) in corners)
    return SessionRow(number=number, refused=refused, corners=numbered, taken=taken)


def _matches(wanted: WantedView, shown: Placement, width: float) -> bool:
    """Whether a view, seen at the place `shown` with the relative `width`, is close
    enough to the `wanted` one to count as it.
    """
    misses = (
        abs(shown.x - wanted.x),
        abs(shown.y - wanted.y),
        abs(width / wanted.size - 1.0),
        max(abs(shown.tilt - wanted.tilt), abs(shown.turn - wanted.turn)),
    )
    return all(
        miss <= allowed for miss, allowed in zip(misses, VIEW_TOLERANCE, strict=True)
    )
