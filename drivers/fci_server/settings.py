"""Settings of the twin's server."""

from ipaddress import IPv4Address
from typing import Annotated

from pydantic import AfterValidator, Field

from drivers.arm_plant import ArmPlant
from drivers.settings import Settings


def _address(text: str) -> str:
    return str(IPv4Address(text))


class ServerSettings(Settings):
    """Address of the server and the clock that the robot follows.

    Without an `address` it takes a free one on the loopback, because the clients fix the ports. In
    `lock_step` a motion advances one control period for each command; otherwise it runs by the wall
    clock, where a late command counts as missed. The arm stands `delay` and a first-order `lag` [s]
    behind its setpoint, as a real one does; one that `chooses_elbow` reaches poses without an elbow
    by the smallest turns of its joints. Without a `plant` it feels gravity alone.
    """

    address: Annotated[str, AfterValidator(_address)] | None = None
    lock_step: bool = True
    delay: float = Field(0.0, ge=0, le=0.1)
    lag: float = Field(0.0, ge=0, le=0.1)
    chooses_elbow: bool = False
    plant: ArmPlant | None = None
