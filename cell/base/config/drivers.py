"""Registry of the drivers of arms and cameras by the names of operators, plug-ins
included.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint
from types import MappingProxyType
from typing import Any, Literal

from drivers.base.plugins import plugin_names, plugins


@dataclass(frozen=True, slots=True)
class Driver:
    """Entry of the registry: how to open the driver of an arm or a camera, and what it
    needs.

    `opener` names, as `module:function`, what opens it: for an arm what makes the
    Devices, as `fci_devices` does, with `open_camera` where nothing is simulated; for a
    real camera what makes a `RealCamera` of its own `settings`, a class named likewise,
    and the clock. `library` is the optional library that it needs. What is `real` is no
    part of the twin: an arm with joints and limits of its own, a camera before which
    nobody knows the truth.
    """

    opener: str
    library: str | None = None
    settings: str = "drivers.settings:Settings"
    real: bool = True

    @property
    def is_franka(self) -> bool:
        """Whether this driver is for a Franka arm, real or emulated, whose joints and
        limits are known.
        """
        return self == DRIVERS["arms"]["fci"]

    def load(self, part: Literal["opener", "settings"] = "opener") -> Any:
        """Import and return what opens the devices (`part` "opener"), or the class of
        their settings ("settings").
        """
        return EntryPoint("driver", getattr(self, part), "folding_cell").load()


Kind = Literal["arms", "cameras"]
DRIVERS: Mapping[Kind, Mapping[str, Driver]] = MappingProxyType(
    {
        "arms": {
            "twin": Driver("cell.base.devices.twin:twin_devices", real=False),
            "fci": Driver("cell.base.devices.fci:fci_devices", "pylibfranka"),
        },
        "cameras": {
            "twin": Driver("", real=False),  # the arm's opener brings it
            "v4l2": Driver("drivers.v4l2.camera:V4l2Camera"),
        },
    }
)


@cache
def all_drivers(kind: Kind) -> Mapping[str, Driver]:
    """All drivers of arms or of cameras (`kind`), by the name that operators use, with
    those of plug-ins.
    """
    return {**DRIVERS[kind], **plugins(kind, Driver, DRIVERS[kind])}


def driver_names(kind: Kind) -> tuple[str, ...]:
    """Names of the drivers of arms or of cameras (`kind`); no plug-in is imported."""
    return (*DRIVERS[kind], *plugin_names(kind))
