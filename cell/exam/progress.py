"""Protocol of progress reports of an exam."""

from collections.abc import Callable

Progress = Callable[[int, int, str], None]
"""Called with how many cases are done, of how many, and what came of the last one."""


def quiet(done: int, total: int, said: str) -> None:
    """Ignore a progress report."""
