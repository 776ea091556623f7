"""Motion slows down as the newest image ages, and waits where an image is in doubt: a gap in the
images is bridged at rest.
"""

from cell.config.monitor_limits import MonitorLimits
from cell.orchestrator.monitors import FOLDING, SEEING
from cell.orchestrator.snapshot import Command, Drive, Hold, MoveTo, Snapshot
from drivers.types import Velocity

# of the allowed age; the twin's images are at most 0.6 old where nothing is measured
USUAL_AGE = 0.7


def pace(command: Command, snapshot: Snapshot, limits: MonitorLimits) -> Command:
    """The `command`, slower by how far the newest image is older than usual: at the allowed age, or
    where the images are in doubt, a driven arm stands, and a move to a pose is held until a younger
    or better image has come.
    """
    frame = snapshot.view.frame
    if frame is None or snapshot.state not in SEEING:
        return command
    left = (limits.image_age - (snapshot.time - frame.stamp)) / (1.0 - USUAL_AGE) / limits.image_age
    if _in_doubt(snapshot):
        left = -1.0
    if isinstance(command, Drive) and left < 1.0:
        share, rate = max(left, 0.0), command.velocity
        return Drive(Velocity(share * rate.vx, share * rate.vz, share * rate.pitch_rate))
    return Hold() if isinstance(command, MoveTo) and left < 0.0 else command


def _in_doubt(snapshot: Snapshot) -> bool:
    """Whether an image speaks against the camera; its monitor waits for more of them to name it."""
    view = snapshot.view
    measured = snapshot.state in FOLDING and (view.doubtful_since is not None or view.moved > 0)
    return view.identical > 1 or measured
