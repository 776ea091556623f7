"""A calibration session as a folder: settings, images, measurements, verdict."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
from pydantic import ConfigDict, Field

from calibration.board import BoardSettings
from calibration.lens import CameraFile
from calibration.wizard.board_views import BoardViews
from calibration.wizard.latency import LatencySettings, LatencySteps
from calibration.wizard.progress import Observer, Progress, SessionRow, ignore
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import TouchSettings
from drivers.base.errors import ConfigurationError, check_known
from drivers.base.files import append_line, write_file, writing
from drivers.base.readers import MEGABYTE, read_json, read_json_lines, read_picture
from drivers.base.settings import VersionedFile, load, parse
from drivers.base.types import Image
from drivers.base.yaml_text import dump_yaml

# of told.jsonl and latency.json; a session writes less than one
LARGEST_LOG = 32 * MEGABYTE
LARGEST_SIDE = 16_384  # px
SESSION_FILE = "session.yaml"
ROWS_FILE = "told.jsonl"
VERDICT_FILE = "verdict.yaml"
IMAGES_FOLDER = "images"
LATENCY_FILE, PICTURE_FILE, POSES_FILE = "latency.json", "picture.png", "poses.yaml"
MAKE_ROOM = "make room"  # remedy for a full disk
FAST_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]
Kind = Literal["camera", "homography"]
Side = Annotated[int, Field(gt=0, le=LARGEST_SIDE)]


class SessionFile(VersionedFile):
    """Contents of session.yaml: the settings of a calibration session.

    `image` is width and height [px], `length` [m] the ruler's length of the board,
    `locks` the values of the locked camera controls, `lens` the one used in a session
    of touches.
    """

    model_config = ConfigDict(extra="allow")  # a program writes it

    kind: Kind
    date: str
    camera: str
    image: tuple[Side, Side]
    locks: dict[str, int] = Field(default_factory=dict)
    length: float | None = Field(None, gt=0, le=10)
    lens: CameraFile | None = None
    boards: BoardSettings = BoardSettings()
    touches: TouchSettings = TouchSettings()
    latency: LatencySettings = LatencySettings()


class SessionFolder:
    """Observer of a calibration wizard that writes each of its messages into the folder
    of a session at once.

    It passes them on to `watch`.
    """

    def __init__(
        self, folder: Path, now: SessionFile, watch: Observer = ignore
    ) -> None:
        """Begin a session with the settings `now` in `folder`, which is new or empty,
        or resume the session that it holds.

        Raises ConfigurationError for a folder that cannot be written, or other settings
        before.
        """
        self.folder = folder
        self.session = now
        self._watch = watch
        if (folder / SESSION_FILE).exists():
            self.session = _resumed(folder, now)
            with writing(folder / ROWS_FILE, MAKE_ROOM):
                append_line(folder / ROWS_FILE, b"\n")  # ends a truncated line
        else:
            with writing(folder):
                (folder / IMAGES_FOLDER).mkdir(parents=True)
            write_yaml(
                folder / SESSION_FILE, now.model_dump(mode="json", by_alias=True)
            )

        self._count = len([*(folder / IMAGES_FOLDER).glob("*.png")])

    def __call__(self, progress: Progress) -> None:
        """Write the measurements in the message `progress`, and its image where that
        was accepted.
        """
        if progress.steps is not None:
            write_file(
                self.folder / LATENCY_FILE, progress.steps.model_dump_json(), MAKE_ROOM
            )
        result = progress.result
        if result is not None:
            image = None
            if progress.frame is not None and result.taken:
                image = progress.frame.image
            self.add(result, image)
        self._watch(progress)

    def add(self, row: SessionRow, image: Image | None = None) -> None:
        """Append `row` to the session's log, and write its `image` of shape (height,
        width, 3) unless that is None; ConfigurationError where writing fails.
        """
        if image is not None:
            name = f"{IMAGES_FOLDER}/{self._count:04d}.png"
            self._count += 1
            write_image(self.folder / name, image)
            row = row.model_copy(update={"image": name})
        line = row.model_dump_json(exclude_defaults=True) + "\n"
        with writing(self.folder / ROWS_FILE, MAKE_ROOM):
            append_line(self.folder / ROWS_FILE, line.encode())


def read_session(folder: Path, kind: Kind) -> SessionFile:
    """Settings of the session in `folder`; ConfigurationError where it is a session of
    another `kind`.
    """
    session = load(folder / SESSION_FILE, SessionFile)
    if session.kind != kind:
        raise ConfigurationError(
            f"{folder}: is a session of `cell calibrate {session.kind}`, not of "
            f"`cell calibrate {kind}`; name another folder"
        )
    return session


def _resumed(folder: Path, now: SessionFile) -> SessionFile:
    """Settings of the session in `folder`; ConfigurationError where any of them differs
    from those `now`.
    """
    stored = read_session(folder, now.kind)
    for key in ("camera", "image", "locks", "boards", "touches", "latency", "lens"):
        before = getattr(stored, key)
        today = getattr(now, key)
        if before != today:
            raise ConfigurationError(
                f"--resume: {folder / SESSION_FILE}: {key}: is {before}, here it is"
                f" {today}; set it back, or begin a new session"
            )
    return stored


def read_rows(folder: Path) -> Iterator[SessionRow]:
    """Yield the rows of the log in a session's `folder`, without a last line that is
    cut off.

    Raises ConfigurationError for a file that cannot be read or a line that is no row.
    """
    path = folder / ROWS_FILE
    for content in read_json_lines(path, LARGEST_LOG):
        yield parse(content, SessionRow, str(path))


def _taken_images(
    folder: Path, session: SessionFile, without: Collection[int]
) -> Iterator[tuple[SessionRow, Image]]:
    """Yield the accepted rows of the session in `folder`, each with its image, except
    those whose numbers are in `without`.

    Raises ConfigurationError for an unknown number, a missing image or one of another
    size.
    """
    accepted: dict[tuple[int, bool], SessionRow] = {}
    for row in read_rows(folder):
        if row.dropped:
            accepted.pop((row.number, row.again), None)
        elif row.image is not None:
            accepted[row.number, row.again] = row
    for number in without:
        check_known(
            "--without", str(number), [str(n) for n, again in accepted if not again]
        )
    for row in accepted.values():
        if row.number not in without:
            yield row, _read_image(folder, row, session.image)


def _read_image(folder: Path, row: SessionRow, size: tuple[int, int]) -> Image:
    """Image that a session's `row` names; ConfigurationError where it is missing, lies
    elsewhere, or has another width and height than `size` [px].
    """
    path = folder / str(row.image)
    if path.resolve().parent != (folder / IMAGES_FOLDER).resolve():
        raise ConfigurationError(
            f"{folder / ROWS_FILE}: image: {row.image} lies outside of {IMAGES_FOLDER}/"
        )

    try:
        image = read_picture(path)
    except ConfigurationError as error:
        raise ConfigurationError(f"{error}; or leave it out by its number") from None

    stored_size = (image.shape[1], image.shape[0])
    if stored_size != size:
        raise ConfigurationError(
            f"{path}: is {stored_size[0]} x {stored_size[1]} px,"
            f" {folder / SESSION_FILE} says image: [{size[0]}, {size[1]}]; width comes"
            " first"
        )
    return image


Task = BoardViews | TouchedPoints


def restore(
    task: Task, folder: Path, session: SessionFile, without: Collection[int] = ()
) -> Image | None:
    """Tell `task` again the accepted images of the session in `folder`, but not the
    numbers in `without`; returns the last image, of shape (height, width, 3), or None
    where there is none.

    Raises ConfigurationError for a broken file or an image that shows nothing.
    """
    image = None
    for row, image in _taken_images(folder, session, without):
        if not task.restore(row, image):
            raise ConfigurationError(
                f"{folder / str(row.image)}: shows no {task.subject}; leave number"
                f" {row.number} out, or take its line out of {ROWS_FILE}"
            )
    return image


def read_steps(folder: Path) -> LatencySteps:
    """Positions of arm and pointer during the arm's steps, read from a session's
    `folder`; empty where they were not recorded there.
    """
    path = folder / LATENCY_FILE
    content = read_json(path, LARGEST_LOG) if path.exists() else {}
    return parse(content, LatencySteps, str(path))


def write_image(path: Path, image: Image) -> None:
    """Write `image`, of shape (height, width, 3), to the file at `path` as a PNG
    picture; ConfigurationError where that fails.
    """
    write_file(path, as_png(image), MAKE_ROOM)


def as_png(image: Image) -> bytes:
    """Content of a PNG file that shows `image`, of shape (height, width, 3);
    ConfigurationError where it cannot be encoded.
    """
    made, content = cv2.imencode(".png", image, FAST_PNG)
    if not made:
        raise ConfigurationError("the picture cannot be written as PNG")
    return content.tobytes()


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    """Write `content` to the file at `path` as YAML; ConfigurationError where that
    fails.
    """
    write_file(path, dump_yaml(content), MAKE_ROOM)
