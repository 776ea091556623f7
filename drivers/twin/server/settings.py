"""What a server of the twin is told when it starts."""

from ipaddress import IPv4Address
from typing import Annotated

from pydantic import AfterValidator

from drivers.settings import Settings


def _address(text: str) -> str:
    return str(IPv4Address(text))


class ServerSettings(Settings):
    """Where the server listens and whose clock the robot follows.

    Without an `address` it takes a free one of its own on the loopback, because the clients fix
    the ports. In `lock_step` a motion advances one control period for each command; otherwise it
    runs by the wall clock, where a command that is late is missed.
    """

    address: Annotated[str, AfterValidator(_address)] | None = None
    lock_step: bool = True
