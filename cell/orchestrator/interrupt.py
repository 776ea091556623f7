"""Handling of Ctrl-C and terminating signals: first a controlled stop, then a stop at once."""

import signal
from types import FrameType
from typing import Any, Self

from drivers.errors import CellError

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(CellError):
    """Error of an operation, other than a fold, that was interrupted from the keyboard."""

    exit_code = 130


class Interrupt:
    """Context manager that counts SIGNALS; the first is only remembered, later ones raise."""

    def __init__(self) -> None:
        self._asked = False
        self._before: dict[signal.Signals, Any] = {}

    def __call__(self) -> bool:
        """Whether a controlled stop was requested."""
        return self._asked

    def __enter__(self) -> Self:
        """Install the signal handlers."""
        self._before = {number: signal.signal(number, self._count_signal) for number in SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the previous signal handlers."""
        for number, before in self._before.items():
            signal.signal(number, before)

    def _count_signal(self, _number: int, _frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
