"""Stored images of a run with measurements and outlines of the strip drawn into
them.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from calibration.calibration import Calibration
from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.region import Region
from cell.record.columns import FARTHEST_HAND, Sights, Ticks
from cell.record.frames import FrameNote, frame_file, read_frame
from cell.record.run import Run
from cell.report.html import jpeg_text
from cell.report.words import seconds
from drivers.base.errors import ConfigurationError, in_mm
from drivers.base.readers import read_picture
from drivers.base.settings import parse
from drivers.base.types import Array, Image
from drivers.strip.file import StripFile

Item = TypeVar("Item")
SHOWN_IMAGES = 6
SHOWN_OUTLINES = 24  # of the strip as it is laid, over the film
WIDTH = 960  # px
VIEW_MARGIN = 0.06  # m around the motion
# m by which a fold stands out beyond the gripper; before, the gripper is in front
FOLDED = 0.005
# m along x, and share of the reach, between which a fold lies
LAID_BEGIN, LAID_SHARE = -0.05, 0.7
LAID_HEIGHTS = (-0.03, 0.09)  # m above the desk around a laid fold
SMALLEST_WINDOW = 0.25  # share of the image's width and height
EIGHTHS, SUBPIXEL_BITS = 8, 3  # of a pixel, the fixed-point unit in which OpenCV draws
MARK_RADIUS = 11  # px
PROFILE_BGR, CONTACT_BGR, TIP_BGR = (40, 110, 255), (255, 120, 30), (255, 255, 255)
LAYING_STATES = ("LAY", "RELEASE")


@dataclass(frozen=True, slots=True)
class Silhouette:
    """Outline of the strip in image `sequence`: `pixels` (n, 2) [px], `plane` (n, 2) x,
    z [m].
    """

    sequence: int
    state: str
    pixels: Array
    plane: Array


@dataclass(frozen=True, slots=True)
class KeyPicture:
    """Image of an HTML page: `jpeg` as base64 text, caption, path `whole` of the full
    image, empty for one of the film.
    """

    jpeg: str
    caption: str
    whole: str


@dataclass(frozen=True, slots=True)
class ShownImages:
    """Index entries of the images that a run's page shows, stored ones and others of
    the film: some of the whole fold, the strip as it is laid, and at most one each amid
    the fold, at the touch and at the end.

    `images` (h, w, 3) are those of them that can be read, by their numbers.
    """

    some: Sequence[FrameNote]
    laid: Sequence[FrameNote]
    middle: Sequence[FrameNote]
    touch: Sequence[FrameNote]
    end: Sequence[FrameNote]
    images: Mapping[int, Image]

    @classmethod
    def of(cls, run: Run) -> Self:
        """Choose the images of `run`, and read its film once."""
        filmed = run.film_stamps()
        notes = [
            note
            for note in run.frame_index()
            if note.file is not None or note.film in filmed
        ]
        touched = None if run.result is None else run.result.t_layer_touch
        over = float(np.max(run.ticks.t, initial=0.0)) if touched is None else touched
        laying = [note for note in notes if _state_at(run, note.stamp) in LAYING_STATES]
        laid = evenly_chosen(laying, SHOWN_OUTLINES)
        some = evenly_chosen(notes, SHOWN_IMAGES)
        middle = _nearest(notes, 0.5 * over)
        touch = () if touched is None else _nearest(notes, touched)
        wanted = [*some, *laid, *middle, *touch, *notes[-1:]]
        images = dict(_readable(run, wanted))
        return cls(some, laid, middle, touch, notes[-1:], images)

    def read(self, notes: Iterable[FrameNote]) -> Iterator[tuple[FrameNote, Image]]:
        """Yield those of `notes` whose image can be read, with it."""
        for note in notes:
            if note.sequence in self.images:
                yield note, self.images[note.sequence]


def _nearest(notes: Sequence[FrameNote], time: float) -> Sequence[FrameNote]:
    """The entry of `notes` that is nearest to `time` [s], alone; none without any."""
    return sorted(notes, key=lambda note: abs(note.stamp - time))[:1]


def _readable(run: Run, notes: Sequence[FrameNote]) -> Iterator[tuple[int, Image]]:
    """Yield numbers and images of those `notes` that can be read: as stored, or else
    from the film.
    """
    filmed = {note.sequence for note in notes if note.file is None}
    for frame in run.film_frames(filmed):
        yield frame.sequence, frame.image
    for note in notes:
        with suppress(ConfigurationError):
            if note.file is not None:
                yield note.sequence, read_picture(note.file)


def key_pictures(
    run: Run, shown: ShownImages, outlines: Sequence[Silhouette] = ()
) -> tuple[KeyPicture, ...]:
    """Images of a whole fold, with its measurements and `outlines` drawn in."""
    pictures = []
    for note, recorded in shown.read(shown.some):
        image = _with_outline(_with_sight(recorded, note, run), note.sequence, outlines)
        calibration = _map_of(image, run)
        if calibration is not None:
            image = window_on(run.ticks, calibration).crop(image)
        pictures.append(_key_picture(image, _caption(note, run), note))
    return tuple(pictures)


def _map_of(image: Image, run: Run) -> Calibration | None:
    """Calibration of the camera that took `image` (h, w, 3); None where `run` has none
    for images of its size.
    """
    calibration = run.calibration()
    fits = calibration is not None and calibration.lens.fits(image)
    return calibration if fits else None


def evenly_chosen(items: Sequence[Item], count: int) -> list[Item]:
    """At most `count` of `items`, evenly spaced from the first to the last."""
    indices = np.linspace(0, len(items) - 1, min(count, len(items))).round().astype(int)
    return [items[i] for i in np.unique(indices)]


def _key_picture(image: Image, caption: str, note: FrameNote) -> KeyPicture:
    """Picture for a page from `image` that links to the file of its `note`, if it is
    stored.
    """
    stored = note.file is not None
    whole = frame_file(Path(), note.sequence).as_posix() if stored else ""
    return KeyPicture(jpeg_text(image, WIDTH), caption, whole)


def close_ups(run: Run, shown: ShownImages) -> tuple[KeyPicture, ...]:
    """Readable images at the layers' touch and at the end, cropped by the run's
    calibration.
    """
    reach = np.max(run.ticks.x, initial=0.1)
    pictures = []
    chosen = {"where the layers touch": shown.touch, "at the end": shown.end}
    for words, notes in chosen.items():
        for note, image in shown.read(notes):
            calibration = _map_of(image, run)
            if calibration is not None:
                part = _laid_part(image, calibration, reach)
                caption = f"{words}  ·  image at {seconds(note.stamp)}"
                pictures.append(_key_picture(part, caption, note))
    return tuple(pictures)


def _laid_part(image: Image, calibration: Calibration, reach: float) -> Image:
    """Crop of `image` (h, w, 3) to where a fold lies whose gripper reached x = `reach`
    [m].
    """
    box = _box(calibration, (LAID_BEGIN, LAID_SHARE * reach), LAID_HEIGHTS)
    if box is None:
        return image
    low, high = box
    size = np.array([image.shape[1], image.shape[0]])
    left, top = np.clip(low, 0, size - 2).astype(int)
    right, bottom = np.clip(high, (left + 2, top + 2), size).astype(int)
    return image[top:bottom, left:right]


def _box(
    calibration: Calibration, x: tuple[float, float], z: tuple[float, float]
) -> tuple[Array, Array] | None:
    """Lowest and highest pixels (2,) of a rectangle in the strip's plane that spans `x`
    and `z` [m]; None where the camera's map has no pixels for it.
    """
    corners = np.array([(along, above) for along in x for above in z])
    pixels = calibration.to_image(corners)
    if not np.isfinite(pixels).all():
        return None
    return pixels.min(axis=0), pixels.max(axis=0)


def poster(run: Run, shown: ShownImages) -> str:
    """Image of a run amid its fold, with what was read in it, as JPEG in base64 text;
    empty without one.
    """
    for note, image in shown.read(shown.middle):
        return jpeg_text(_with_sight(image, note, run))
    return ""


def window_on(ticks: Ticks, calibration: Calibration) -> Region:
    """Region of the image around the gripper's motion, with the image's aspect
    ratio.
    """
    whole = np.array(calibration.lens.size)
    right, top = (np.max(way, initial=0.0) for way in (ticks.x, ticks.z))
    ends = -VIEW_MARGIN, right + VIEW_MARGIN
    box = _box(calibration, ends, (-VIEW_MARGIN, top + VIEW_MARGIN))
    if box is None:
        return Region(0, 0, *whole.tolist())

    low, high = box
    share = float(np.clip(np.max((high - low) / whole), SMALLEST_WINDOW, 1.0))
    size = np.round(whole * share).astype(int)

    middle = (low + high) / 2
    start = np.clip(middle - size / 2, 0, whole - size).astype(int)
    return Region(*start.tolist(), *(start + size).tolist())


def fold_tips(sights: Sights, ticks: Ticks) -> Array:
    """Fold tip (n, 2) x, z [m] in each image of a run; NaN while the strip is not
    folded.
    """
    tips = np.stack([sights.tip_x, sights.tip_z], axis=1)
    if ticks.t.size == 0:
        return tips
    folded = sights.tip_x > np.interp(sights.stamp, ticks.t, ticks.x) + FOLDED
    return np.where(folded[:, None], tips, np.nan)


def draw_sight(
    image: Image, calibration: Calibration, curve: Array, contact_x: float, tip: Array
) -> Image:
    """Copy of `image` with the measured profile (m, 2), contact and fold tip (2,) [m]
    drawn.
    """
    import cv2

    drawn = image.copy()
    pixels = _pixels(curve, calibration)
    if len(pixels) > 1:
        cv2.polylines(
            drawn, [pixels], False, PROFILE_BGR, 3, cv2.LINE_AA, shift=SUBPIXEL_BITS
        )
    for point, colour in ((np.array([contact_x, 0.0]), CONTACT_BGR), (tip, TIP_BGR)):
        for centre in _pixels(point[None], calibration):
            radius = EIGHTHS * MARK_RADIUS
            cv2.circle(
                drawn, centre.tolist(), radius, colour, 4, cv2.LINE_AA, SUBPIXEL_BITS
            )
    return drawn


def _pixels(points: Array, calibration: Calibration) -> NDArray[np.int32]:
    """Pixels (k, 2), in eighths, of those `points` (m, 2) x, z [m] that lie near the
    image.
    """
    near = points[(np.abs(points) < FARTHEST_HAND).all(axis=1)]  # no NaN is
    if len(near) == 0:
        return np.empty((0, 2), dtype=np.int32)
    pixels = calibration.to_image(near)

    farthest = 4 * max(calibration.lens.size)
    inside = (np.abs(pixels) < farthest).all(axis=1)
    return np.rint(EIGHTHS * pixels[inside]).astype(np.int32)


def _with_sight(image: Image, note: FrameNote, run: Run) -> Image:
    """Copy of `image` (h, w, 3) with its measurement drawn in; `image` itself without
    one.
    """
    sights, calibration = run.sights(), _map_of(image, run)
    rows = np.flatnonzero(sights.sequence == note.sequence)
    if calibration is None or rows.size == 0:
        return image
    row = int(rows[0])
    curve = dict(run.profile.curves()).get(float(sights.stamp[row]), np.empty((0, 2)))
    tip = fold_tips(sights, run.ticks)[row]
    return draw_sight(image, calibration, curve, float(sights.contact_x[row]), tip)


def _with_outline(image: Image, sequence: int, outlines: Sequence[Silhouette]) -> Image:
    """Copy of `image` (h, w, 3) with those `outlines` drawn that belong to number
    `sequence`.
    """
    import cv2

    rings = [
        np.rint(o.pixels).astype(np.int32) for o in outlines if o.sequence == sequence
    ]
    return (
        cv2.polylines(image.copy(), rings, True, PROFILE_BGR, 2, cv2.LINE_AA)
        if rings
        else image
    )


def _caption(note: FrameNote, run: Run) -> str:
    """Caption of an image: its time, the run's state, and the measured contact."""
    words = [seconds(note.stamp)]
    sights = run.sights()
    if note.stamp < 0:
        words.append("before the lift")
    elif run.ticks.state:
        words.append(_state_at(run, note.stamp))
    contact = sights.contact_x[sights.sequence == note.sequence]
    if contact.size and np.isfinite(contact[0]):
        words.append(f"contact {in_mm(contact[0])}")
    return "  ·  ".join(words)


def silhouettes(run: Run, shown: ShownImages) -> tuple[Silhouette, ...]:
    """Outlines of the strip in the images that show it laid and released, in order of
    time.

    Empty where the picture before the grasp, calibration, strip or ticks are not in the
    record.
    """
    try:
        return tuple(_outlines(run, shown))
    # an image or a setting that was changed: the page goes without
    except ConfigurationError:
        return ()


def _outlines(run: Run, shown: ShownImages) -> Iterator[Silhouette]:
    """Yield outlines of the strip, by the appearance learnt from the image before the
    grasp.
    """
    flat = next((note for note in run.kept_images() if note.stamp < 0), None)
    before = None if flat is None else read_frame(flat)
    calibration, stated = run.calibration(), run.header.strip_file
    if not shown.laid or before is None or calibration is None or stated is None:
        return
    strip = parse(stated, StripFile, "run.yaml: strip_file")
    appearance = inspect(before, calibration, strip).appearance
    if appearance is None:
        return

    perception = Perception(calibration, strip, appearance)
    for note, image in shown.read(shown.laid):
        if not calibration.lens.fits(image):
            continue
        gripper = run.ticks.pose_at(note.stamp)
        pixels = perception.outline(replace(before, image=image), gripper)
        if len(pixels):
            state = _state_at(run, note.stamp)
            plane = calibration.to_plane(pixels)
            yield Silhouette(note.sequence, state, pixels, plane)


def _state_at(run: Run, stamp: float) -> str:
    """State of the run at `stamp` [s]; empty before the lift, or where states are not
    recorded.
    """
    states = run.ticks.state
    if stamp < 0 or not states:
        return ""
    row = int(np.searchsorted(run.ticks.t, stamp))
    return states[min(row, len(states) - 1)]
