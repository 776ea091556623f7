"""Pixel formats, sizes and rates that a device offers."""

from collections.abc import Iterator
from dataclasses import dataclass

from drivers.camera.abi import Fraction, FrameInterval, FrameSize, Request, letters
from drivers.camera.device import Device

DISCRETE = 1  # V4L2_FRMSIZE_TYPE_DISCRETE, V4L2_FRMIVAL_TYPE_DISCRETE


@dataclass(frozen=True, slots=True)
class Mode:
    """A pixel format and size; `rates` [Hz], where the device lists them, fastest first.

    For a stepwise size `width` and `height` are the largest, and `steps` describes the range.
    """

    format: str
    description: str
    width: int
    height: int
    rates: tuple[float, ...]
    steps: bool

    def __str__(self) -> str:
        rates = ", ".join(f"{rate:g}" for rate in self.rates) or "any rate"
        return f"{self.format} {'up to ' * self.steps}{self.width}x{self.height} at {rates}"


def modes_of(device: Device) -> Iterator[Mode]:
    """Every mode that the device names, in its own order."""
    for described in device.formats():
        number = described.pixelformat
        for size in _sizes(device, number):
            steps = size.type != DISCRETE
            # stepwise: min, max, step of the width, then of the height; discrete: width, height
            width, height = (size.steps[1], size.steps[4]) if steps else tuple(size.steps[:2])
            rates = _rates(device, number, width, height)
            text = described.description.decode(errors="replace")
            yield Mode(letters(number), text, width, height, rates, steps)


def _sizes(device: Device, number: int) -> Iterator[FrameSize]:
    return device.enumerate_entries(
        Request.ENUM_FRAMESIZES, lambda i: FrameSize(index=i, pixel_format=number)
    )


def _rates(device: Device, number: int, width: int, height: int) -> tuple[float, ...]:
    def at(index: int) -> FrameInterval:
        return FrameInterval(index=index, pixel_format=number, width=width, height=height)

    found = device.enumerate_entries(Request.ENUM_FRAMEINTERVALS, at)
    rates = {_rate(step) for interval in found for step in _range_ends(interval)}
    return tuple(sorted((rate for rate in rates if rate > 0), reverse=True))


def _range_ends(interval: FrameInterval) -> list[Fraction]:
    """Both ends of a range of frame intervals, or the one interval."""
    return list(interval.steps[: 1 if interval.type == DISCRETE else 2])


def _rate(interval: Fraction) -> float:
    return interval.denominator / interval.numerator if interval.numerator else 0.0
