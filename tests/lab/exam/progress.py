"""Type of the callback for progress reports of an exam."""

from collections.abc import Callable

Progress = Callable[[int, int, str], None]
"""Called with the number of cases done, the total, and a text on the last one."""


def quiet(done: int, total: int, text: str) -> None:
    """Ignore a progress report."""
