"""Controls of a V4L2 camera: listing them, switching automatics off, setting values and
reading them back.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from drivers.base.readers import read_yaml
from drivers.v4l2.abi import (
    Control,
    ControlFlag,
    ControlQuery,
    ControlType,
    Ioctl,
    MenuQuery,
)
from drivers.v4l2.device import CameraRefused, Device

AUTOMATICS = read_yaml(Path(__file__).with_name("automatics.yaml"))  # off, by name
EXPOSURE = "exposure_time_absolute"
EXPOSURE_UNIT = 1e-4  # s
LOCKED_OUT = {
    ControlFlag.DISABLED: "is disabled",
    ControlFlag.READ_ONLY: "can only be read",
    ControlFlag.GRABBED: "is held by another program",
    ControlFlag.INACTIVE: "is inactive: another control holds it",
}


@dataclass(frozen=True, slots=True)
class CameraControl:
    """Control of a V4L2 camera, with its range; `entries` are the texts of a menu by
    number, and `value` is None if unreadable.
    """

    number: int
    name: str
    kind: ControlType
    low: int
    high: int
    step: int
    default: int
    flags: ControlFlag
    value: int | None
    entries: Mapping[int, str]

    @property
    def obstacle(self) -> str | None:
        """Reason why the control cannot be set now; None where it can."""
        return next(
            (reason for flag, reason in LOCKED_OUT.items() if flag & self.flags), None
        )

    @property
    def allowed(self) -> str:
        """Allowed values of the control, as text for the operator."""
        if self.entries:
            return ", ".join(
                f"{number} ({text})" for number, text in self.entries.items()
            )
        return f"{self.low} to {self.high} in steps of {self.step}"


def controls_of(device: Device) -> dict[str, CameraControl]:
    """Controls of `device` that are supported and enabled, by their names as v4l2-ctl
    spells them.
    """
    controls = dict[str, CameraControl]()
    query = ControlQuery(id=ControlFlag.NEXT)
    while device.supports(Ioctl.QUERYCTRL, query):
        if query.type in set(ControlType) and not query.flags & ControlFlag.DISABLED:
            control = _control(device, query)
            controls[control.name] = control
        query = ControlQuery(id=query.id | ControlFlag.NEXT)
    return controls


def lock(device: Device, values: Mapping[str, int]) -> dict[str, int]:
    """Switch automatic controls off, set `values` by name, and return the values of all
    controls set, as read back.

    Raises CameraRefused for a control that the device lacks or a value that it does not
    take.
    """
    present = controls_of(device)
    for name in values:
        if name not in present:
            names = ", ".join(sorted(present)) or "none"
            raise CameraRefused(
                device.path, f"controls.{name}", f"unknown; allowed: {names}"
            )

    settable = {name for name, control in present.items() if control.obstacle is None}
    locks = {name: value for name, value in AUTOMATICS.items() if name in settable}
    locks.update(values)

    # automatics first: while one is on, the values that it controls cannot be set
    for name, value in sorted(
        locks.items(), key=lambda item: item[0] not in AUTOMATICS
    ):
        _set(device, present[name], value)

    return {
        name: _read_back(device, present[name], value) for name, value in locks.items()
    }


def _control(device: Device, query: ControlQuery) -> CameraControl:
    """Control that `device` describes by `query`, with its present value and menu
    entries.
    """
    flags = ControlFlag(query.flags & sum(ControlFlag))
    kind = ControlType(query.type)
    readable = kind is not ControlType.BUTTON and not flags & ControlFlag.WRITE_ONLY
    return CameraControl(
        number=query.id,
        # as v4l2-ctl spells it: "White Balance" is white_balance
        name=re.sub(
            r"[^a-z0-9]+", "_", query.name.decode(errors="replace").lower()
        ).strip("_"),
        kind=kind,
        low=query.minimum,
        high=query.maximum,
        step=query.step,
        default=query.default_value,
        flags=flags,
        value=_value(device, query.id) if readable else None,
        entries=_entries(device, query, kind),
    )


def _entries(device: Device, query: ControlQuery, kind: ControlType) -> dict[int, str]:
    """Texts of a menu control's entries by their numbers; empty for other controls."""
    if kind not in {ControlType.MENU, ControlType.INTEGER_MENU}:
        return {}
    entries = {}
    for index in range(query.minimum, query.maximum + 1):
        reply = MenuQuery(id=query.id, index=index)
        if device.supports(Ioctl.QUERYMENU, reply):
            named = kind is ControlType.MENU
            entries[index] = (
                reply.entry.name.decode() if named else str(reply.entry.value)
            )
    return entries


def _set(device: Device, control: CameraControl, value: int) -> None:
    """Set `control` of `device` to `value`; raises CameraRefused where the device does
    not accept it.
    """
    # it may have gone with an automatic
    obstacle = controls_of(device)[control.name].obstacle
    if obstacle is not None:
        raise CameraRefused(device.path, f"controls.{control.name}", obstacle)
    if not device.supports(Ioctl.S_CTRL, Control(id=control.number, value=value)):
        raise CameraRefused(
            device.path,
            f"controls.{control.name}",
            f"{value}; allowed: {control.allowed}",
        )


def _read_back(device: Device, control: CameraControl, value: int) -> int:
    """Value of `control` as read back after it was set to `value`; raises CameraRefused
    where they differ.
    """
    accepted = _value(device, control.number)
    if accepted != value:
        problem = f"{value} became {accepted}; allowed: {control.allowed}"
        raise CameraRefused(device.path, f"controls.{control.name}", problem)
    return accepted


def _value(device: Device, number: int) -> int:
    reply = device.call(Ioctl.G_CTRL, Control(id=number), "reading a control")
    return int(reply.value)
