"""Ctrl-C: the first requests a controlled stop, the second stops at once."""

import signal
from types import FrameType, TracebackType
from typing import Any, Self

from drivers.errors import CellError


class Interrupted(CellError):
    """Stopped from the keyboard outside a fold, which records that itself."""

    exit_code = 130


class Interrupt:
    """Context manager that counts SIGINT; the first is only remembered, later ones raise."""

    def __init__(self) -> None:
        self._asked = False
        self._before: Any = None

    def __call__(self) -> bool:
        """Whether a controlled stop was requested."""
        return self._asked

    def __enter__(self) -> Self:
        """Install the signal handler."""
        self._before = signal.signal(signal.SIGINT, self._hear)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the previous signal handler."""
        signal.signal(signal.SIGINT, self._before)

    def _hear(self, _number: int, _frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
