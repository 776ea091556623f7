"""Processes that die before one of their system calls that change files."""

import os
from collections.abc import Callable

from drivers.base.errors import ConfigurationError

DIED, REFUSED = 9, 2


def in_child(action: Callable[[], object], *, dies_at: int | None = None) -> int:
    """Exit code of `action` in a process of its own, killed before its system call
    `dies_at`.
    """
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            if dies_at is not None:
                count_down(dies_at)
            action()
            code = 0
        except ConfigurationError:
            code = REFUSED
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def count_down(left: int) -> None:
    """Let this process die before the call `left` of those that change files."""
    calls = [left]

    def dying(call):
        def stands_in(*given, **named):
            if calls[0] == 0:
                os._exit(DIED)
            calls[0] -= 1
            return call(*given, **named)

        return stands_in

    for name in ("fsync", "replace", "rename", "unlink", "open", "mkdir", "rmdir"):
        setattr(os, name, dying(getattr(os, name)))


def no_room(*_: object) -> None:
    """A disk that takes no more."""
    raise OSError(28, "No space left on device")
