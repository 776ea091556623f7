"""Motion slows down as the newest image ages: a gap in the images is bridged by waiting."""

from cell.config.monitor_limits import MonitorLimits
from cell.orchestrator.monitors import SEEING
from cell.orchestrator.snapshot import Command, Drive, Hold, MoveTo, Snapshot
from drivers.types import Velocity

# of the allowed age; the twin's images are at most 0.6 old where nothing is measured
USUAL_AGE = 0.7


def pace(command: Command, snapshot: Snapshot, limits: MonitorLimits) -> Command:
    """The `command`, slower by how far the newest image is older than usual: at the allowed age a
    driven arm stands, and a move to a pose is held until a younger image has come.
    """
    frame = snapshot.view.frame
    if frame is None or snapshot.state not in SEEING:
        return command
    left = (limits.image_age - (snapshot.time - frame.stamp)) / (1.0 - USUAL_AGE) / limits.image_age
    if isinstance(command, Drive) and left < 1.0:
        share, rate = max(left, 0.0), command.velocity
        return Drive(Velocity(share * rate.vx, share * rate.vz, share * rate.pitch_rate))
    return Hold() if isinstance(command, MoveTo) and left < 0.0 else command
