"""Reading and writing of films: images with the time of each."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np

from drivers.errors import ConfigurationError
from drivers.files import check_writable, replacing, writing
from drivers.types import Frame, Image

TIME_BASE = Fraction(1, 90_000)  # s, the time base of films that are written
Encoder = Literal["libx264"]  # of a fold's film; SVT-AV1 hangs in one of some hundred
ENCODER = "libx264"  # which every player knows
KEYFRAME_INTERVAL = 60  # images between two from which decoding can start
QUALITY = {
    "libx264": {"crf": "28", "preset": "ultrafast", "bf": "0", "tune": "zerolatency"},
    "libx265": {"crf": "24", "preset": "veryfast", "x265-params": "bframes=0:log-level=error"},
}
# Of an .mp4: every image is on its way to the disk once the next one is encoded.
FRAGMENTS = {"movflags": "frag_every_frame+empty_moov+default_base_moof", "flush_packets": "1"}


@dataclass(frozen=True, slots=True)
class Film:
    """A film by one fixed camera, in the file at `path`."""

    path: Path

    def frames(self, after: float = 0.0) -> Iterator[Frame]:
        """Images (h, w, 3) of the film with their stamps [s] since the first one.

        They begin with one at or shortly before `after` [s], in a film whose own stamps begin at 0.

        Raises ConfigurationError for a file that is missing or no film.
        """
        import av

        with _opened(self.path) as container:
            begin = 0.0 if after else None
            if after:
                container.seek(round(after * av.time_base))
            for number, picture in enumerate(container.decode(video=0)):
                stamp = _stamp(picture, self.path)
                begin = stamp if begin is None else begin
                image = _upright(picture, self.path)
                yield Frame(stamp - begin, stamp - begin, self.path.name, number, image)

    def packets(self) -> Iterator[bytes]:
        """Encoded images of an H.264 film in order, as a stream of bytes (its Annex B).

        Raises ConfigurationError for a file that is missing or no such film.
        """
        import av

        with _opened(self.path) as container:
            stream = container.streams.video[0]
            to_bytes = av.BitStreamFilterContext("h264_mp4toannexb", stream)
            for packet in container.demux(stream):
                yield from map(bytes, to_bytes.filter(packet))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open the film at `path`; ConfigurationError for what cannot be read."""
    import av

    if not path.is_file():
        what = "is a folder; name a film in it" if path.is_dir() else "is not there"
        raise ConfigurationError(f"{path}: {what}")
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise ConfigurationError(f"{path}: holds no picture track")
            yield container
    except (av.FFmpegError, OSError) as error:
        raise ConfigurationError(
            f"{path}: cannot be read as a film: {error.strerror or error}"
        ) from None


def _upright(picture: Any, path: Path) -> Image:
    """The image (h, w, 3) turned as the film's display matrix says: a phone is held anyhow."""
    turns, rest = divmod(picture.rotation, 90)
    if rest:
        raise ConfigurationError(
            f"{path}: is to be shown turned by {picture.rotation} deg; write it again upright"
        )
    return np.ascontiguousarray(np.rot90(picture.to_ndarray(format="bgr24"), turns))


def _stamp(picture: Any, path: Path) -> float:
    if picture.pts is None or picture.time_base is None:
        raise ConfigurationError(
            f"{path}: its images carry no time; write it again with a program that keeps them"
        )
    return float(picture.pts * picture.time_base)


class FilmWriter:
    """Writes images of one size into a film, of which a kill loses only the last image.

    The film has no B-frames; a stamp is kept to 1/90,000 s.
    """

    def __init__(self, path: Path, encoder: str = ENCODER) -> None:
        """Create the film at `path` (.mkv or .mp4), encoded by FFmpeg's encoder `encoder`."""
        import av

        options = FRAGMENTS if path.suffix == ".mp4" else {}
        with writing(path):
            check_writable(path)
            self._container = av.open(str(path), "w", options=options)
        self._path, self._encoder, self._begin = path, encoder, 0.0
        self._stream: Any = None

    def add(self, stamp: float, image: Image) -> None:
        """Add an `image` (h, w, 3) of even sides, taken at `stamp` [s], later than the last one."""
        import av
        import cv2

        if self._stream is None:
            self._begin = stamp
            self._stream = self._open_stream(image)
        planes = cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420)  # three times as fast as FFmpeg
        picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        picture.pts, picture.time_base = round((stamp - self._begin) / TIME_BASE), TIME_BASE
        self._container.mux(self._stream.encode(picture))

    def __enter__(self) -> Self:
        """Return this writer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Flush the encoder, close the file and index it."""
        if self._stream is not None:
            self._container.mux(self._stream.encode(None))
        self._container.close()
        if self._stream is not None:
            index_film(self._path)

    def _open_stream(self, image: Image) -> Any:
        options = {"g": str(KEYFRAME_INTERVAL), **QUALITY.get(self._encoder, {})}
        stream = self._container.add_stream(self._encoder, rate=30, options=options)
        stream.height, stream.width = image.shape[:2]
        stream.pix_fmt, stream.time_base = "yuv420p", TIME_BASE
        stream.codec_context.time_base = TIME_BASE
        stream.codec_context.thread_count = 1
        stream.codec_context.open()
        return stream


def index_film(path: Path) -> None:
    """Give the .mp4 at `path` an index, so that players know how long it is and can seek in it.

    Its images stay as they were encoded. Raises ConfigurationError for a file that is no film.
    """
    import av

    if path.suffix != ".mp4":
        return
    with replacing(path) as scratch, _opened(path) as old:
        form = {"format": "mp4", "options": {"movflags": "faststart"}}
        with av.open(str(scratch), "w", **form) as new:
            stream = new.add_stream_from_template(old.streams.video[0], opaque=True)
            for packet in old.demux(video=0):
                if packet.dts is not None:
                    packet.stream = stream
                    new.mux(packet)
