"""Camera errors with names, each of which states its remedy."""

import errno

from drivers.errors import ConfigurationError, Fault

GONE_ERRNOS = frozenset({errno.ENODEV, errno.ENXIO, errno.ENOENT})


class CameraLost(Fault):
    """The device does not exist or was unplugged."""

    def __init__(self, device: str, found: str) -> None:
        super().__init__(
            "camera_lost",
            f"{device}: {found}; plug the camera in, `cell camera` lists what is there",
        )


class CameraStalled(Fault):
    """The device exists but delivers no frames."""

    def __init__(self, device: str, seconds: float) -> None:
        super().__init__(
            "camera_stalled",
            f"{device}: no frame for {seconds:.2f} s; check cable and USB bandwidth, "
            "then plug the camera in anew",
        )


class CameraBusy(Fault):
    """Another program streams from the device."""

    def __init__(self, device: str, users: str) -> None:
        super().__init__("camera_busy", f"{device}: is in use by {users}; close that program")


class CameraFaulty(Fault):
    """The device exists but fails, or delivers only corrupt frames."""

    def __init__(self, device: str, found: str) -> None:
        super().__init__(
            "camera_faulty",
            f"{device}: {found}; the stream is started anew, if it stays so try another cable "
            "or port",
        )


class CameraRefused(ConfigurationError):
    """The device does not support what the cell file requests; no substitute is made silently."""

    def __init__(self, device: str, key: str, problem: str) -> None:
        super().__init__(f"{device}: {key}: {problem}")


def translate_error(error: OSError, device: str, doing: str, users: str) -> Fault | CameraRefused:
    """Camera error in place of an OSError raised while `doing` something to `device`."""
    reason = error.strerror or str(error)
    if error.errno in GONE_ERRNOS:
        return CameraLost(device, f"{reason} while {doing}")
    if error.errno == errno.EBUSY:
        return CameraBusy(device, users)
    if error.errno in {errno.EACCES, errno.EPERM}:
        return CameraRefused(device, "device", "may not be opened; join the group video")
    if error.errno == errno.ENOTTY:
        return CameraRefused(device, "device", f"{reason} while {doing}: it cannot do that")
    return CameraFaulty(device, f"{reason} while {doing}")
