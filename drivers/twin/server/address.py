"""Loopback address of a twin: the clients fix the ports, so each twin has its own address."""

from collections.abc import Callable, Iterator
from typing import TypeVar

from drivers.errors import ConfigurationError

A = TypeVar("A")
B = TypeVar("B")


def bind_free(address: str | None, open_at: Callable[[str], tuple[A, B]]) -> tuple[str, A, B]:
    """Bind two ports at `address`, or at the first loopback address where both are free.

    Raises ConfigurationError where they are in use.
    """
    reason = ""
    for candidate in (address,) if address else _candidates():
        try:
            return (candidate, *open_at(candidate))
        except OSError as error:
            reason = error.strerror or str(error)
    raise ConfigurationError(
        f"address: ports 1337 and 1338 cannot be opened at {address or '127.77.x.y'}: {reason}; "
        "name another address of this machine"
    )


def _candidates() -> Iterator[str]:
    return (f"127.77.{number // 250}.{number % 250 + 1}" for number in range(2500))
