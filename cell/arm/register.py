"""Registration of the cell frame in the robot's base, by three points that the fingers touch."""

import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from cell.config.places import Configs
from drivers.errors import CellError, ConfigurationError
from drivers.files import change_file
from drivers.installation import Mounting
from drivers.types import Array

TOUCH_POINTS = (
    "the middle of the strip's fixed edge, on the desk",
    "the middle of the strip's other edge, on the desk",
    "a point of the desk beside the strip, at least 0.1 m from it",
)
MOST_TILT = np.radians(0.5)  # rad that the desk may be tilted
STRETCH = 0.005  # m, allowed difference of the touched length from the strip's
OFF_LINE = 0.1  # m, at least, of the third point from the line of the first two
MOUNTING_LINE = re.compile(r"^(?P<indent>\s*)mounting:[ \t]*\{[^}]*\}[^\n]*$", re.MULTILINE)


def mounting_from_points(points: Array, length: float) -> Mounting:
    """Mounting of the robot, from touched `points` (3, 3) [m] at TOUCH_POINTS in its base.

    Raises CellError for a strip of another `length` [m] or a desk that is not level.
    """
    fixed, other, beside = points
    along = other - fixed
    distance = float(np.linalg.norm(along))
    if abs(distance - length) > STRETCH:
        raise CellError(
            f"register: the edges are {1e3 * distance:.1f} mm apart, the strip is "
            f"{1e3 * length:.1f} mm long; allowed: {1e3 * STRETCH:.0f} mm; touch both edges again"
        )
    normal = np.cross(along, beside - fixed)
    if float(np.linalg.norm(normal)) < OFF_LINE * distance:
        raise CellError(
            f"register: the third point is too near the strip; allowed: at least {OFF_LINE:.1f} m "
            "beside it; touch it again"
        )
    tilt = float(np.arccos(np.clip(abs(normal[2]) / np.linalg.norm(normal), 0.0, 1.0)))
    if tilt > MOST_TILT:
        raise CellError(
            f"register: the desk is tilted by {np.degrees(tilt):.2f} deg to the robot's base, "
            f"allowed {np.degrees(MOST_TILT):.1f} deg; level the desk or the robot"
        )
    x, y, z = fixed.tolist()
    yaw = float(np.arctan2(along[1], along[0]))
    return Mounting(x=round(x, 5), y=round(y, 5), z=round(z, 5), yaw=round(yaw, 5))


def write_mounting(configs: Configs, mounting: Mounting) -> Path:
    """Write `mounting` into cell.yaml, the old one as a comment; returns the file's path.

    Raises ConfigurationError where the file has no such line.
    """
    path = configs.folder / "cell.yaml"
    change_file(path, lambda text: _with_mounting(text, mounting, path))
    configs.cell()
    return path


def _with_mounting(text: str, mounting: Mounting, path: Path) -> str:
    """Text of cell.yaml with the line of `mounting` replaced, the old line as a comment."""
    found = MOUNTING_LINE.search(text)
    if found is None:
        raise ConfigurationError(
            f"{path}: installation.mounting: must stand on one line, as {_mounting_line(mounting)}"
        )
    indent = found["indent"]
    date = datetime.now(UTC).date().isoformat()
    old = f"{indent}# until {date}: {found[0].strip()}"
    return f"{text[: found.start()]}{old}\n{indent}{_mounting_line(mounting)}{text[found.end() :]}"


def _mounting_line(m: Mounting) -> str:
    """Line of cell.yaml that states the mounting: x, y, z [m] and yaw [rad]."""
    return f"mounting: {{x: {m.x}, y: {m.y}, z: {m.z}, yaw: {m.yaw}}}"
