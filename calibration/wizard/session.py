"""A calibration session as a folder: settings, images, measurements, verdict."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import yaml
from pydantic import ConfigDict, Field

from calibration.board_settings import BoardSettings
from calibration.lens import CameraFile
from calibration.touch_settings import TouchSettings
from calibration.wizard.latency import LatencySettings
from drivers.errors import ConfigurationError
from drivers.settings import Settings, load, parse
from drivers.types import Image

SESSION, ROWS, VERDICT, IMAGES = "session.yaml", "told.jsonl", "verdict.yaml", "images"
LATENCY, PICTURE = "latency.json", "picture.png"
FAST = [cv2.IMWRITE_PNG_COMPRESSION, 1]
Kind = Literal["camera", "homography"]


class Session(Settings):
    """session.yaml: the settings of the session.

    `image` is width and height [px], `length` [m] the ruler's length of the board, `locks` the
    values of the locked camera controls, `lens` that of a session of touches.
    """

    model_config = ConfigDict(extra="allow")  # a program writes it

    schema_: Literal[1] = Field(1, alias="schema")
    kind: Kind
    date: str
    camera: str
    image: tuple[int, int]
    locks: dict[str, int] = Field(default_factory=dict)
    length: float | None = None
    lens: CameraFile | None = None
    boards: BoardSettings = BoardSettings()
    touches: TouchSettings = TouchSettings()
    latency: LatencySettings = LatencySettings()


class Row(Settings):
    """One line of told.jsonl: an accepted or refused image and its measurements.

    `corners` are [id, u, v] of the board, `centre` of the pointer; `pose` x, z, pitch of the arm.
    """

    model_config = ConfigDict(extra="allow")

    number: int
    image: str | None = None
    refused: str | None = None
    corners: tuple[tuple[int, float, float], ...] = ()
    centre: tuple[float, float] | None = None
    pose: tuple[float, float, float] | None = None
    again: bool = False

    @property
    def taken(self) -> bool:
        """Whether this image counts."""
        return self.image is not None


class SessionFolder:
    """Writes a session as it goes, so that nothing is lost when it stops."""

    def __init__(self, folder: Path, session: Session) -> None:
        """Create `folder`, which must be new or empty; one that cannot be written is a
        ConfigurationError.
        """
        self.folder = folder
        self._count = 0
        try:
            (folder / IMAGES).mkdir(parents=True)
        except OSError as error:
            raise ConfigurationError(f"{folder}: cannot be written: {error.strerror}") from None
        self.describe(session)

    def describe(self, session: Session) -> None:
        """Write session.yaml, again when more is known."""
        write_yaml(self.folder / SESSION, session.model_dump(mode="json", by_alias=True))

    def add(self, row: Row, image: Image | None = None) -> None:
        """Add a row; with its `image` (height, width, 3) where it was accepted."""
        if image is not None:
            name = f"{IMAGES}/{self._count:04d}.png"
            self._count += 1
            write_image(self.folder / name, image)
            row = row.model_copy(update={"image": name})
        with (self.folder / ROWS).open("a", encoding="utf-8") as stream:
            stream.write(row.model_dump_json(exclude_defaults=True) + "\n")

    def keep(self, name: str, content: Mapping[str, Any]) -> None:
        """Write `content` as JSON."""
        (self.folder / name).write_text(json.dumps(content) + "\n", encoding="utf-8")


def read_session(folder: Path, kind: Kind) -> Session:
    """session.yaml of `folder`; another kind of session is a ConfigurationError."""
    session = load(folder / SESSION, Session)
    if session.kind != kind:
        raise ConfigurationError(
            f"{folder}: is a session of `cell calibrate {session.kind}`, not of "
            f"`cell calibrate {kind}`; name another folder"
        )
    return session


def read_rows(folder: Path) -> Iterator[Row]:
    """Rows of told.jsonl, without a truncated last line.

    Raises ConfigurationError for a file that cannot be read or a line that is not JSON.
    """
    path = folder / ROWS
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    for number, line in enumerate(lines, start=1):
        try:
            content = json.loads(line)
        except ValueError:
            if number == len(lines):
                return
            raise ConfigurationError(f"{path}: line {number}: is not JSON; remove it") from None
        yield parse(content, Row, f"{path}: line {number}")


def read_image(folder: Path, row: Row, size: tuple[int, int]) -> Image:
    """The image of a row (height, width, 3); missing, or not of `size` [px]: ConfigurationError."""
    path = folder / str(row.image)
    if path.resolve().parent != (folder / IMAGES).resolve():
        raise ConfigurationError(f"{folder / ROWS}: image: {row.image} lies outside of {IMAGES}/")
    image = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
    if image is None:
        raise ConfigurationError(f"{path}: is missing or no picture; leave it out by its number")
    found = (image.shape[1], image.shape[0])
    if found != size:
        raise ConfigurationError(
            f"{path}: is {found[0]} x {found[1]} px, {folder / SESSION} says image: "
            f"[{size[0]}, {size[1]}]; width comes first"
        )
    return np.asarray(image, dtype=np.uint8)


def read_latency(folder: Path) -> dict[str, Any]:
    """Arm and image measurements during the steps: `arm` [[t, x, z]] and `seen` [[t, u, v]].

    Raises ConfigurationError for a file that cannot be read.
    """
    path = folder / LATENCY
    if not path.exists():
        return {"arm": [], "seen": []}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {"arm": np.reshape(content["arm"], (-1, 3)), "seen": content["seen"]}
    except (OSError, ValueError, KeyError, TypeError):
        raise ConfigurationError(f"{path}: cannot be read as steps of the arm") from None


def write_image(path: Path, image: Image) -> None:
    """Write a picture (height, width, 3); ConfigurationError where it cannot be written."""
    if not cv2.imwrite(str(path), image, FAST):
        raise ConfigurationError(f"{path}: cannot be written; make room")


def write_yaml(path: Path, content: Mapping[str, Any]) -> None:
    """Write `content`; a place that cannot be written is a ConfigurationError."""
    try:
        path.write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None
