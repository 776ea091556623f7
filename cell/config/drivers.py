"""Registry of the drivers of arms and cameras by the names of operators, plug-ins included."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint
from types import MappingProxyType
from typing import Any, Literal

from drivers.errors import check_known
from drivers.plugins import plugin_names, plugins


@dataclass(frozen=True, slots=True)
class Driver:
    """Entry of the registry: how to open the driver of an arm or a camera, and what it needs.

    `opener` names, as `module:function`, what opens it: `twin_devices` is the example of an arm,
    `with_real_camera` that of a camera. `library` and `section` are the optional library and the
    section of cell.yaml that it needs. What is `real` is no part of the twin: an arm with joints
    and limits of its own, a camera before which nobody knows the truth.
    """

    opener: str
    library: str | None = None
    section: str | None = None
    real: bool = True

    @property
    def is_franka(self) -> bool:
        """Whether it drives a Franka arm, real or emulated, whose joints and limits are known."""
        return self.section == "fci"

    def load(self) -> Callable[..., Any]:
        """Import and return the driver's function that opens devices."""
        loaded: Callable[..., Any] = EntryPoint("driver", self.opener, "folding_cell").load()
        return loaded


Kind = Literal["arms", "cameras"]
DRIVERS: Mapping[Kind, Mapping[str, Driver]] = MappingProxyType(
    {
        "arms": {
            "twin": Driver("cell.devices.twin:twin_devices", real=False),
            "fci": Driver("cell.devices.fci:fci_devices", library="pylibfranka", section="fci"),
        },
        "cameras": {
            "twin": Driver("cell.devices.twin:with_twin_camera", real=False),
            "v4l2": Driver("cell.devices.real_camera:with_real_camera", section="camera"),
        },
    }
)


def driver(kind: Kind, name: str) -> Driver:
    """Driver that operators call `name`; ConfigurationError for an unknown name."""
    known = all_drivers(kind)
    check_known(kind.removesuffix("s"), name, known)
    return known[name]


@cache
def all_drivers(kind: Kind) -> Mapping[str, Driver]:
    """Drivers of this `kind`, with those of plug-ins, by the name that operators use."""
    return {**DRIVERS[kind], **plugins(kind, Driver, DRIVERS[kind])}


def driver_names(kind: Kind) -> tuple[str, ...]:
    """Names of the drivers of this `kind`; no plug-in is imported."""
    return (*DRIVERS[kind], *plugin_names(kind))
