"""Parts of a stand-in for the kernel: controls, buffers, what goes wrong."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drivers.camera.abi import Request


@dataclass
class Knob:
    """A control: allowed range, value, and the name of the automatic that holds it."""

    number: int
    low: int
    high: int
    value: int
    held_by: str | None = None


def usual_knobs() -> dict[str, Knob]:
    """Controls as a USB camera has them, automatics on."""
    return {
        "Brightness": Knob(0x980900, 0, 255, 128),
        "White Balance, Automatic": Knob(0x98090C, 0, 1, 1),
        "Auto Exposure": Knob(0x9A0901, 0, 3, 3),
        "Exposure Time, Absolute": Knob(0x9A0902, 1, 5000, 157, "Auto Exposure"),
        "Exposure, Dynamic Framerate": Knob(0x9A0903, 0, 1, 1),
    }


@dataclass
class Filled:
    """A buffer that waits to be taken."""

    index: int
    sequence: int
    stamp: float
    flags: int
    size: int


@dataclass
class Memory:
    """A mapping of a buffer."""

    content: np.ndarray
    closed: Callable[[], None]

    def copy(self, length: int) -> np.ndarray:
        return self.content[:length].copy()

    def close(self) -> None:
        self.closed()


@dataclass
class Faults:
    """What goes wrong, as the test says."""

    refuse: dict[Request, deque[int]] = field(default_factory=dict)
    drop: set[int] = field(default_factory=set)  # sequences, which still count
    all_dropped: bool = False
    corrupt: set[int] = field(default_factory=set)
    short: set[int] = field(default_factory=set)
    stuck: bool = False  # poll reports an error and nothing else
    ahead: float = 0.0  # s that stamps are off
    repeat: bool = False  # the counter does not move
