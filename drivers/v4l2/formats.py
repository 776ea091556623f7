"""Modes of a V4L2 device, and its picture format: set, read back, and decoded to BGR
images.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from drivers.base.types import Image
from drivers.v4l2 import abi
from drivers.v4l2.device import CameraRefused, Device
from drivers.v4l2.settings import V4l2Settings

DISCRETE = 1  # V4L2_FRMSIZE_TYPE_DISCRETE, V4L2_FRMIVAL_TYPE_DISCRETE
RATE_TOLERANCE = 0.01
NO_RATE = 0.0  # Hz
PER_SECOND = 1000  # a rate as a fraction of whole numbers
JPEG_BEGIN, JPEG_END = b"\xff\xd8", b"\xff\xd9"

Decoder = Callable[[Image], Image]


@dataclass(frozen=True, slots=True)
class CameraMode:
    """Mode of a camera: pixel format, size [px] and frame `rates` [Hz], fastest first,
    if listed.

    `steps` is set where sizes are a range, of which `width` and `height` are the
    largest.
    """

    format: str
    description: str
    width: int
    height: int
    rates: tuple[float, ...]
    steps: bool

    def __str__(self) -> str:
        rates = ", ".join(f"{rate:g}" for rate in self.rates) or "any rate"
        return (
            f"{self.format} {'up to ' * self.steps}{self.width}x{self.height} at"
            f" {rates}"
        )


def modes_of(device: Device) -> Iterator[CameraMode]:
    """Yield every mode of pixel format and size that the device lists, in the device's
    order.
    """
    formats = device.enumerate_entries(
        abi.Ioctl.ENUM_FMT, lambda i: abi.FormatDescription(index=i, type=abi.CAPTURE)
    )
    for described in list(formats):
        number = described.pixelformat
        by_index = partial(abi.FrameSize, pixel_format=number)
        for size in device.enumerate_entries(abi.Ioctl.ENUM_FRAMESIZES, by_index):
            steps = size.type != DISCRETE
            # stepwise: min, max, step of the width, then of the height; discrete:
            # width, height
            width = size.steps[1] if steps else size.steps[0]
            height = size.steps[4] if steps else size.steps[1]
            rates = _rates(device, number, width, height)
            text = described.description.decode(errors="replace")
            yield CameraMode(
                format=abi.letters(number),
                description=text,
                width=width,
                height=height,
                rates=rates,
                steps=steps,
            )


def _rates(device: Device, number: int, width: int, height: int) -> tuple[float, ...]:
    """Frame rates [Hz] of the pixel format `number` at a picture of `width` x `height`,
    fastest first; for a range, its two ends.
    """
    intervals = device.enumerate_entries(
        abi.Ioctl.ENUM_FRAMEINTERVALS,
        lambda i: abi.FrameInterval(
            index=i, pixel_format=number, width=width, height=height
        ),
    )
    rates = set()
    for interval in intervals:
        # a discrete one states its rate, a range its shortest and longest interval
        stated = 1 if interval.type == DISCRETE else 2
        rates |= {_rate(step) for step in interval.steps[:stated]}
    return tuple(sorted(rates - {NO_RATE}, reverse=True))


def _rate(interval: abi.Fraction) -> float:
    if not interval.numerator:
        return NO_RATE
    rate: float = interval.denominator / interval.numerator
    return rate


def _convert(code: int) -> Decoder:
    return lambda pixels: np.asarray(cv2.cvtColor(pixels, code), np.uint8)


# A Bayer pattern is named by its first row and the one below it: RGGB has red at (0,
# 0).
RAW: dict[str, tuple[int, Decoder]] = {
    "YUYV": (2, _convert(cv2.COLOR_YUV2BGR_YUYV)),
    "GREY": (1, _convert(cv2.COLOR_GRAY2BGR)),
    "RGGB": (1, _convert(cv2.COLOR_BayerRGGB2BGR)),
    "GRBG": (1, _convert(cv2.COLOR_BayerGRBG2BGR)),
    "BA81": (1, _convert(cv2.COLOR_BayerBGGR2BGR)),
    "GBRG": (1, _convert(cv2.COLOR_BayerGBRG2BGR)),
}
READABLE_FORMATS = frozenset({*RAW, "MJPG"})


@dataclass(frozen=True, slots=True)
class PictureFormat:
    """Picture format that a camera has accepted; `line` is the length of a row in
    bytes, `rate` is in Hz.
    """

    format: str
    width: int
    height: int
    line: int
    rate: float

    def is_complete(self, content: Image) -> bool:
        """Whether the bytes `content` (n,) are a complete picture, by length or JPEG
        markers.

        A truncated JPEG decodes to a grey area without an error.
        """
        if self.format != "MJPG":
            return content.size >= self.line * self.height
        # some cameras fill their buffer with zeros
        picture = content.tobytes().rstrip(b"\0")
        return picture.startswith(JPEG_BEGIN) and picture.endswith(JPEG_END)

    def decode(self, content: Image) -> Image | None:
        """BGR image (height, width, 3) from the bytes `content` (n,); None if
        incomplete.
        """
        width = self.width
        height = self.height
        if not self.is_complete(content):
            return None
        if self.format == "MJPG":
            image = cv2.imdecode(content, cv2.IMREAD_COLOR)
            if image is None or image.shape != (height, width, 3):
                return None
            return np.asarray(image, np.uint8)

        depth, decoder = RAW[self.format]
        lines = content[: self.line * height].reshape(height, self.line)
        pixels = np.ascontiguousarray(lines[:, : width * depth])
        return decoder(pixels.reshape(height, width, depth))


def negotiate(device: Device, settings: V4l2Settings) -> PictureFormat:
    """Set pixel format, size and rate of `device`, and return them as read back.

    Raises CameraRefused with the supported modes where they differ from `settings`;
    CameraBusy while another program streams.
    """
    request = abi.Format(type=abi.CAPTURE)
    pix = request.fmt.pix
    pix.width = settings.width
    pix.height = settings.height
    pix.pixelformat = abi.fourcc(settings.format)
    pix.field = abi.ANY_FIELD
    pix = device.call(abi.Ioctl.S_FMT, request, "setting the format").fmt.pix
    name = abi.letters(pix.pixelformat)
    requested = f"{settings.format} {settings.width}x{settings.height}"
    accepted = f"{name} {pix.width}x{pix.height}"
    if accepted != requested:
        problem = f"{requested} became {accepted}; allowed: {_offered_formats(device)}"
        raise CameraRefused(device.path, "format", problem)
    if pix.field != abi.PROGRESSIVE:
        raise CameraRefused(
            device.path, "format", "is interlaced; use a progressive mode"
        )

    rate = _negotiate_rate(device, settings)
    return PictureFormat(
        format=name,
        width=pix.width,
        height=pix.height,
        line=pix.bytesperline,
        rate=rate,
    )


def _negotiate_rate(device: Device, settings: V4l2Settings) -> float:
    """Set the frame rate of `device` and return it as read back [Hz]; raises
    CameraRefused where it differs from `settings`.
    """
    wanted = settings.rate
    request = abi.StreamParameters(type=abi.CAPTURE)
    request.parm.capture.timeperframe = abi.Fraction(
        PER_SECOND, round(PER_SECOND * wanted)
    )
    device.call(abi.Ioctl.S_PARM, request, "setting the rate")
    parameters = abi.StreamParameters(type=abi.CAPTURE)
    reply = device.call(abi.Ioctl.G_PARM, parameters, "reading the rate")
    rate = _rate(reply.parm.capture.timeperframe)
    if abs(rate - wanted) > RATE_TOLERANCE * wanted:
        problem = (
            f"{wanted:g} Hz became {rate:g} Hz; allowed: {_offered_formats(device)}"
        )
        raise CameraRefused(device.path, "rate", problem)

    return rate


def _offered_formats(device: Device) -> str:
    usable = (mode for mode in modes_of(device) if mode.format in READABLE_FORMATS)
    return "; ".join(str(mode) for mode in usable) or "none that this driver reads"
