"""Measurement of a fold on a film, made without the cell's arm, into a run folder."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
from scipy.interpolate import PchipInterpolator
from scipy.signal import savgol_filter

from calibration.calibration import Calibration, load_calibration, save_calibration
from cell.base.config.cell import CellFile
from cell.base.config.places import find_configs
from cell.folding.filmed_board import calibrate_film
from cell.perception.held_end import PROFILE_CONFIDENCE, Clip, HeldEnd, HeldMeasurement
from cell.perception.layer_touch import LayerTouch
from cell.perception.preflight import inspect
from cell.perception.scene import Appearance
from cell.perception.strip_measurement import SeenTouch
from cell.record.documents import write_document
from cell.record.files import CALIBRATION, OVERLAY, RESULT, RUN, TICKS
from cell.record.film import Film, FilmWriter
from cell.record.tables import SIGHT_ROWS, place_contacts, sight_tables, write_tables
from cell.record.writer import sight_row
from cell.report.overlay import draw_sight
from drivers.base.errors import ConfigurationError
from drivers.base.files import check_free, new_folder
from drivers.base.types import Array, Frame, Image, Pose
from drivers.strip.file import StripFile
from drivers.strip.model import CONTACT_HEIGHT

ROW_PERIOD = 0.01  # s between rows of ticks, as the contract of a run asks for
SMOOTHED = 5  # images over which the held end is smoothed
FEWEST_IMAGES = 10  # images in which the held end must be found
SIGMA_FLOORS = {"gripper": 0.002, "contact_x": 0.001, "displacement": 0.004}
"""One sigma [m] at least of what a film without an arm shows: compression smooths the
edges, and the held end is where the strip's length ends
(tests/end_to_end/test_observe.py).
"""
# m of strip at its end that may be off the desk where it counts as flat
FLAT_LENGTH = 0.01
PROPORTIONS = 0.02  # share by which those of film and calibration may differ
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class FilmMeasurement:
    """Result of the measurement of a film: the run `folder`, and the number of `images`
    up to the touch of the layers.

    `read` counts the latter. The run begins `begin` [s] after the film.
    """

    folder: Path
    begin: float
    images: int
    read: int
    touch: SeenTouch | None


def observe(
    film: Path,
    calibration: Calibration | Path | None,
    strip_name: str,
    folder: Path,
    configs: str | Path | None = None,
    progress: Progress = lambda _time: None,
) -> FilmMeasurement:
    """Measure the fold that the video at `film` shows and write it into the run
    `folder`, with a copy of the video in which the measurement is drawn.

    The film begins with the strip lying flat and still; without a `calibration`, with
    the printed board that stands in the plane of its edge, and the strip lies still
    after that, held by a clip. `progress` is called with the time [s] of each image.
    Raises ConfigurationError for a film that cannot be read, shows no such strip, board
    or clip, or is of another camera than the calibration, and leaves no folder then.
    """
    configurations = find_configs(configs)
    cell = configurations.cell()
    strip = configurations.strip(strip_name)
    if isinstance(calibration, Path):
        calibration = load_calibration(calibration)
    check_free(folder)

    begin = 0.0
    by_board = calibration is None
    if calibration is None:
        calibration, begin = calibrate_film(
            film, Film(film).frames(), cell.boards, strip
        )
    frames = _frames(film, calibration, begin)
    first = next(frames, None)
    if first is None:
        raise ConfigurationError(f"{film}: holds no image")

    appearance = _appearance(first, film, calibration, strip, by_board=by_board)
    clip = _clip(first, film, calibration, strip) if by_board else None
    held_end = HeldEnd(calibration, strip, appearance, clip)
    with new_folder(folder) as new_run:
        with FilmWriter(new_run / OVERLAY) as overlay:
            overlay.add(first.stamp, first.image)
            layers = LayerTouch(strip)
            measured, touch = _measure(
                frames, held_end, layers, calibration, overlay, progress
            )
        _check_enough(measured, film)
        path = _held_path(measured, strip)
        _write(
            folder=new_run,
            measured=measured,
            path=path,
            strip=strip,
            calibration=calibration,
            touch=touch,
        )
        write_document(new_run / RUN, _header(cell, strip, calibration, measured))

    confident = sum(map(_is_confident, measured))
    return FilmMeasurement(
        folder=folder, begin=begin, images=len(measured), read=confident, touch=touch
    )


def _frames(film: Path, calibration: Calibration, begin: float) -> Iterator[Frame]:
    """Yield the images of the video at `film` from `begin` [s] on, scaled to the size
    of the calibration, with times that count from `begin`.

    Raises ConfigurationError for unlike images.
    """
    lens = calibration.lens
    for frame in Film(film).frames():
        if frame.stamp < begin:
            continue

        height, width = frame.image.shape[:2]
        if abs(width * lens.height / (height * lens.width) - 1.0) > PROPORTIONS:
            raise ConfigurationError(
                f"{film}: is {width} x {height}, the calibration is for {lens.width} x "
                f"{lens.height} pixels; calibrate this camera as it films"
            )

        image = frame.image
        if (width, height) != lens.size:
            image = cv2.resize(image, lens.size, interpolation=cv2.INTER_AREA)

        stamp = frame.stamp - begin
        yield Frame(
            stamp=stamp,
            arrival=stamp,
            source=frame.source,
            sequence=frame.sequence,
            image=image,
        )


def _appearance(
    first: Frame,
    film: Path,
    calibration: Calibration,
    strip: StripFile,
    *,
    by_board: bool,
) -> Appearance:
    """How the strip looks in the `first` image of a film, by which later images are
    measured; ConfigurationError where it does not lie flat there.
    """
    checked = inspect(first, calibration, strip)
    failed = next((check for check in checked.checks if not check.passed), None)
    # a board checks length
    if checked.appearance is not None and (by_board or failed is None):
        return checked.appearance
    problem = (
        "no strip is seen" if failed is None else f"{failed.reason}; {failed.remedy}"
    )
    raise ConfigurationError(
        f"{film}: its first image must show the strip lying flat: {problem}"
    )


def _clip(first: Frame, film: Path, calibration: Calibration, strip: StripFile) -> Clip:
    """Clip that holds the strip's end in the `first` image of a film;
    ConfigurationError where none is seen.
    """
    clip = Clip.learn(first.image, calibration, strip)
    if clip is None:
        raise ConfigurationError(
            f"{film}: no clip is seen at the strip's end; hold the end by a flat clip"
            " of one colour, unlike strip, desk and hand, that shows more length than"
            " height"
        )
    return clip


def _measure(
    frames: Iterator[Frame],
    held_end: HeldEnd,
    layers: LayerTouch,
    calibration: Calibration,
    overlay: FilmWriter,
    progress: Progress,
) -> tuple[list[HeldMeasurement], SeenTouch | None]:
    """Measure the images of a film up to the touch of the strip's layers; returns the
    measurements, and the touch, None where there is none.
    """
    measured: list[HeldMeasurement] = []
    touch: SeenTouch | None = None
    for frame in frames:
        image = frame.image
        if touch is None:
            held = held_end.measure(frame.restamp(-calibration.latency))
            measured.append(held)
            image = _draw_measurement(image, held, calibration)
            if held.end is not None and _is_confident(held):
                touch = layers.update(held.measurement, held.end)
        overlay.add(frame.stamp, image)
        progress(frame.stamp)
    return measured, touch


def _draw_measurement(
    image: Image, held: HeldMeasurement, calibration: Calibration
) -> Image:
    """Copy of `image` in which the measured strip is drawn as a line, and its held end
    as a cross.
    """
    end = held.end
    strip = held.measurement
    curve = strip.profile if _is_confident(held) else np.empty((0, 2))
    drawn = draw_sight(image, calibration, curve, strip.contact_x, np.array(strip.tip))
    if end is not None:
        pixels = calibration.to_image(np.array([[end.x, end.z]]))
        centre = np.rint(pixels[0]).astype(int).tolist()
        cv2.drawMarker(drawn, centre, (0, 255, 255), cv2.MARKER_CROSS, 24, 3)
    return drawn


def _is_confident(held: HeldMeasurement) -> bool:
    """Whether the held end of the strip was found in an image, and its measurement
    there is reliable enough.
    """
    return held.end is not None and held.measurement.confidence >= PROFILE_CONFIDENCE


def _check_enough(measured: Sequence[HeldMeasurement], film: Path) -> None:
    """Raise ConfigurationError where too few images of the video at `film` show the
    lifted strip.
    """
    count = sum(map(_is_confident, measured))
    if count < FEWEST_IMAGES:
        raise ConfigurationError(
            f"{film}: the lifted strip was found in {count} of {len(measured)} images,"
            f" at least {FEWEST_IMAGES} are needed; light it evenly, hold the camera"
            " still, or calibrate it again"
        )


def _write(
    folder: Path,
    measured: Sequence[HeldMeasurement],
    path: Mapping[str, Array],
    strip: StripFile,
    calibration: Calibration,
    touch: SeenTouch | None,
) -> None:
    """Write the tables, the calibration and the result of a filmed fold into the run
    `folder`, with times from the film's first image.
    """
    rows = [sight_row(held.measurement) for held in measured if _is_confident(held)]
    sights = pa.Table.from_pylist(rows, SIGHT_ROWS)
    stamps = np.asarray(sights["stamp"])
    contacts = np.asarray(sights["contact_x"])
    # what seems to touch the desk there is the clip
    contacts = np.where(contacts > strip.length - FLAT_LENGTH, np.nan, contacts)

    contact_x, contact_t = place_contacts(path["t"], stamps, contacts)
    ticks = {**path, "contact_x": contact_x, "contact_t": contact_t}
    write_tables(folder, sight_tables(sights) | {TICKS: pa.table(ticks)})
    save_calibration(calibration, folder / CALIBRATION)

    result: dict[str, object] = {"schema": 1, "outcome": "path_done"}
    if touch is not None:
        result |= {"outcome": "layer_touch", **touch.facts()}
    write_document(folder / RESULT, result)


def _header(
    cell: CellFile,
    strip: StripFile,
    calibration: Calibration,
    measured: Sequence[HeldMeasurement],
) -> dict[str, object]:
    """Content of the header file of a filmed fold: the noise of its measurements, its
    strip, and the calibration.
    """
    period = float(np.median(np.diff([held.measurement.stamp for held in measured])))
    floors = SIGMA_FLOORS | {"touch_time": period}
    return {
        "schema": 1,
        "strip": strip.name,
        "sigma": {
            k: max(v, floors.get(k, 0.0)) for k, v in cell.sigma.model_dump().items()
        },
        "start": "flat",
        "contact_height": CONTACT_HEIGHT,
        "seen_by": "cell",
        "calibration": {"id": calibration.id, "error": calibration.residual},
    }


def _held_path(
    measured: Sequence[HeldMeasurement], strip: StripFile
) -> dict[str, Array]:
    """Path of the strip's held end from the flat strip on, as columns `t` [s], `x` and
    `z` [m], and pitch [rad].
    """
    ends = [
        (held.measurement.stamp, held.end) for held in measured if held.end is not None
    ]
    lift, _ = ends[0]

    # at rest in the first image, and in the last one in which the strip lay flat
    lying_at = {0.0}
    for held in measured:
        image = held.measurement
        if image.stamp < lift and image.contact_x > strip.length - FLAT_LENGTH:
            lying_at = {0.0, image.stamp}
    lying = Pose(strip.length, 0.0, 0.0)
    resting = [(stamp, lying) for stamp in sorted(lying_at) if stamp < lift]

    rows = [(stamp, *pose.as_array()) for stamp, pose in [*resting, *ends]]
    stamps, x, z, pitch = np.array(rows).T
    t = np.arange(stamps[0], stamps[-1], ROW_PERIOD)
    path = np.stack([x, z, np.unwrap(pitch)])
    # each image by a parabola through it and its neighbours
    if len(stamps) >= SMOOTHED:
        path = savgol_filter(path, SMOOTHED, 2)
    columns = (PchipInterpolator(stamps, values)(t) for values in path)
    return dict(zip(("t", "x", "z", "pitch"), (t, *columns), strict=True))
