"""Video files with a time stamp for each image: reading, writing, and encoding during a
run.
"""

import os
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from math import inf
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Literal

import numpy as np

from drivers.base.child import Child, ChildDied, SharedImage
from drivers.base.errors import ConfigurationError
from drivers.base.files import check_writable, replacing, writing
from drivers.base.types import Frame, Image

TIME_BASE = Fraction(1, 90_000)  # s, the time base of films that are written
Encoder = Literal["libx264"]  # of a fold's film; SVT-AV1 hangs in one of some hundred
ENCODER = "libx264"  # which every player knows
PERIOD = 0.02  # s, the least between images of a run's film: an eye sees no more
KEYFRAME_INTERVAL = 60  # images between two from which decoding can start
QUALITY = {
    "libx264": {"crf": "28", "preset": "ultrafast", "bf": "0", "tune": "zerolatency"},
    "libx265": {
        "crf": "24",
        "preset": "veryfast",
        "x265-params": "bframes=0:log-level=error",
    },
}
# Of an .mp4: every image is on its way to the disk once the next one is encoded.
FRAGMENTS = {
    "movflags": "frag_every_frame+empty_moov+default_base_moof",
    "flush_packets": "1",
}
POLITE = 10  # nice value of the encoder
# s to encode an image, or to complete the film: then the encoder hangs
ENCODER_TIMEOUT = 20.0


@dataclass(frozen=True, slots=True)
class Film:
    """Video file at `path`, which was filmed by a camera that stands still."""

    path: Path

    def frames(
        self, after: float = 0.0, only: Collection[int] | None = None
    ) -> Iterator[Frame]:
        """Yield the images of the film with their times [s], which count from the first
        image; `only` limits them to these numbers, counted from the first one yielded.

        They begin with one at or shortly before `after` [s], in a film whose own stamps
        begin at 0. Raises ConfigurationError for a file that is missing or no film.
        """
        path = self.path
        import av

        with _open_film(path) as container:
            track = _longest_track(container)
            begin = None
            if after:
                begin = 0.0
                container.seek(round(after * av.time_base))
            for number, picture in enumerate(container.decode(track)):
                stamp = _stamp(picture, path)
                if begin is None:
                    begin = stamp
                if only is not None and number not in only:
                    continue
                image = _upright(picture, path)
                yield Frame(
                    stamp=stamp - begin,
                    arrival=stamp - begin,
                    source=path.name,
                    sequence=number,
                    image=image,
                )

    def packets(self) -> Iterator[bytes]:
        """Yield the encoded images of an H.264 film as bytes in the Annex B format;
        ConfigurationError for any other film.
        """
        import av

        with _open_film(self.path) as container:
            stream = _longest_track(container)
            to_bytes = av.BitStreamFilterContext("h264_mp4toannexb", stream)
            for packet in container.demux(stream):
                yield from map(bytes, to_bytes.filter(packet))


@contextmanager
def _open_film(path: Path) -> Iterator[Any]:
    """Context with the opened film at `path`; ConfigurationError where there is no such
    film.
    """
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


def _longest_track(container: Any) -> Any:
    """Video track of an opened film that holds most images, as others may be a cover or
    a preview.
    """
    tracks = container.streams.video
    if len(tracks) == 1:
        return tracks[0]
    counts = Counter(packet.stream.index for packet in container.demux(*tracks))
    container.seek(0)
    return max(tracks, key=lambda track: counts[track.index])


def _upright(picture: Any, path: Path) -> Image:
    """Pixels of a decoded `picture`, turned upright as the film says.

    Raises ConfigurationError for a turn that is no multiple of 90 deg.
    """
    quarter_turns, remainder = divmod(picture.rotation, 90)
    if remainder:
        raise ConfigurationError(
            f"{path}: is to be shown turned by {picture.rotation} deg; write it again"
            " upright"
        )
    return np.ascontiguousarray(
        np.rot90(picture.to_ndarray(format="bgr24"), quarter_turns)
    )


def _stamp(picture: Any, path: Path) -> float:
    """Time [s] of a decoded `picture` in its film; ConfigurationError where it has
    none.
    """
    if picture.pts is None or picture.time_base is None:
        raise ConfigurationError(
            f"{path}: its images carry no time; write it again with a program that"
            " keeps them"
        )
    return float(picture.pts * picture.time_base)


class FilmWriter(AbstractContextManager["FilmWriter"]):
    """Writer of images of equal size to a video file; where its process is killed, at
    most the last image is lost.

    The film has no B-frames; a stamp is kept to 1/90,000 s.
    """

    def __init__(self, path: Path, encoder: str = ENCODER) -> None:
        """Create the film at `path`, which ends in .mkv or .mp4, to be encoded by the
        encoder of FFmpeg called `encoder`.
        """
        import av

        options = FRAGMENTS if path.suffix == ".mp4" else {}
        with writing(path):
            check_writable(path)
            self._container = av.open(str(path), "w", options=options)
        self._path = path
        self._encoder = encoder
        self._begin = 0.0
        self._stream: Any = None

    def add(self, stamp: float, image: Image) -> None:
        """Add an `image` of shape (height, width, 3), both even, at the time `stamp`
        [s], which must be later than that of the image before.
        """
        import av
        import cv2

        if self._stream is None:
            self._begin = stamp
            self._stream = self._open_stream(image)
        # three times as fast as FFmpeg
        planes = cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420)
        picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        picture.time_base = TIME_BASE
        picture.pts = round((stamp - self._begin) / TIME_BASE)
        self._container.mux(self._stream.encode(picture))

    def __exit__(self, *_: object) -> None:
        """Write what the encoder still holds, and close the film so that players can
        seek in it.
        """
        if self._stream is not None:
            self._container.mux(self._stream.encode(None))
        self._container.close()
        if self._stream is not None:
            _index_film(self._path)

    def _open_stream(self, image: Image) -> Any:
        """Open the video track of the film for images of the size of `image`, and
        return it.
        """
        options = {"g": str(KEYFRAME_INTERVAL), **QUALITY.get(self._encoder, {})}
        stream = self._container.add_stream(self._encoder, rate=30, options=options)
        stream.height, stream.width = image.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.time_base = TIME_BASE
        stream.codec_context.time_base = TIME_BASE
        stream.codec_context.thread_count = 1
        stream.codec_context.open()
        return stream


def _index_film(path: Path) -> None:
    """Write an index into the .mp4 film at `path`, so that players can seek; a film of
    another kind stays as it is.
    """
    import av

    if path.suffix != ".mp4":
        return
    with replacing(path) as scratch, _open_film(path) as old:
        options = {"movflags": "faststart"}
        with av.open(str(scratch), "w", format="mp4", options=options) as new:
            stream = new.add_stream_from_template(old.streams.video[0], opaque=True)
            for packet in old.demux(video=0):
                if packet.dts is not None:
                    packet.stream = stream
                    new.mux(packet)


class RunFilm:
    """Film of the images of a run, with at most one image in each fixed period;
    `failure` says why it breaks off, if it does.

    Beside a control loop on the wall clock its encoder has a process of its own: a
    thread that lost its core while it held the interpreter would hold up the loop.
    Where the clock is virtual, `patient`, the caller encodes. No run ends for the sake
    of a film, which is for eyes.
    """

    def __init__(self, path: Path, encoder: str, patient: bool) -> None:
        self.failure = ""
        self._count = 0
        self._next_stamp = -inf
        with self._unless_it_fails():
            self._film: FilmWriter | FilmProcess
            self._film = (
                FilmWriter(path, encoder) if patient else FilmProcess(path, encoder)
            )

    def put(self, stamp: float, image: Image) -> int | None:
        """Add `image`, of shape (height, width, 3) and taken at `stamp` [s], and return
        its number in the film; None where it is left out.
        """
        if self.failure or stamp < self._next_stamp:
            return None
        number = None
        with self._unless_it_fails():
            self._film.add(stamp, image)
            number = self._count
            self._count += 1
            self._next_stamp = stamp + PERIOD
        return number

    def close(self) -> None:
        """Complete the film; an error only sets `failure`."""
        with self._unless_it_fails(), self._film:
            pass

    @contextmanager
    def _unless_it_fails(self) -> Iterator[None]:
        """Context that suppresses an error within it, and keeps the first one as the
        reason why the film breaks off.
        """
        try:
            yield
        except Exception as error:  # noqa: BLE001  no run ends for its sake
            self.failure = self.failure or f"the film breaks off: {error}"


class FilmProcess(AbstractContextManager["FilmProcess"]):
    """Writer of a video file in a process of its own, which completes the film even
    where the process that uses it dies.
    """

    def __init__(self, path: Path, encoder: str) -> None:
        """Start the process that encodes the film at `path`; ChildDied where it cannot
        open the film.
        """
        self._image = SharedImage()
        self._child = Child(encode, path, encoder, self._image)
        try:
            self._await_answer()
        except (ChildDied, OSError):
            self._close()
            raise

    def add(self, stamp: float, image: Image) -> None:
        """Add `image`, of shape (height, width, 3), with the time `stamp` [s], later
        than that of the image before; ChildDied or OSError where the film broke off.
        """
        self._image.write(image)
        self._child.send((stamp, image.shape))
        self._await_answer()

    def __exit__(self, *_: object) -> None:
        """Wait until the film is complete; ChildDied or OSError where it broke off."""
        try:
            self._child.send(None)  # no image follows
            self._await_answer()
        finally:
            self._close()

    def _close(self) -> None:
        """End the encoding process, and release the memory that it shares with this
        one.
        """
        self._child.close(ENCODER_TIMEOUT)
        self._image.close()

    def _await_answer(self) -> None:
        """Wait for the answer of the encoding process; ChildDied where it has ended,
        OSError where it hangs.
        """
        if self._child.receive(ENCODER_TIMEOUT) is None:
            self._child.kill()
            raise OSError("its encoder hangs")


def encode(pipe: Connection, path: Path, encoder: str, image: SharedImage) -> None:
    """Encode the image in shared memory for each message in `pipe`, as the main
    function of the encoding process.

    A message is its stamp [s] and shape (h, w, 3), or None for the end of the film. The
    answer is True once the film is open, has the image, and is complete.
    """
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with FilmWriter(path, encoder) as film:
        pipe.send(True)
        os.setpriority(os.PRIO_PROCESS, 0, POLITE)
        # the parent has ended: so has the film
        with suppress(EOFError, ConnectionResetError):
            while (message := pipe.recv()) is not None:
                stamp, shape = message
                film.add(stamp, image.read(shape))
                pipe.send(True)
    pipe.send(True)
