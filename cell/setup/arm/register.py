"""Registration of the cell frame in the robot's base, by three points that the fingers
touch.
"""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.linalg import norm

from cell.base.config.cell import CellFile
from cell.base.config.places import Configs
from drivers.base.errors import CellError, in_mm
from drivers.base.files import change_file
from drivers.base.geometry import EDGE_AHEAD
from drivers.base.installation import Mounting
from drivers.base.settings import parse
from drivers.base.types import Array
from drivers.base.yaml_text import edit_yaml, parse_yaml
from drivers.franka.kinematics import pose_from_columns
from drivers.franka.shapes import TIP_AHEAD

TOUCH_POINTS = (
    "the middle of the strip's fixed edge, on the desk",
    "the middle of the strip's other edge, on the desk",
    "a point of the desk beside the strip, at least 0.1 m from it",
)
MOST_TILT = np.radians(0.5)  # rad that the desk may be tilted
STRETCH = 0.005  # m, allowed difference of the touched length from the strip's
OFF_LINE = 0.1  # m, at least, of the third point from the line of the first two


def touched_point(pose: Sequence[float]) -> Array:
    """Point [m], an array of shape (3,) in the frame of the robot's base, that the
    closed fingers touch when the arm reports the sixteen numbers `pose`.

    A pose is that of the middle between the pads: the fingers reach beyond it.
    """
    hand = pose_from_columns(pose)
    return hand[:3, 3] + (EDGE_AHEAD + TIP_AHEAD) * hand[:3, 2]


def mounting_from_points(points: Array, length: float) -> Mounting:
    """Where the robot stands in the cell, computed from `points` [m] of shape (3, 3) in
    the frame of its base that its fingers have touched, a row for each.

    Raises CellError for a strip of another `length` [m] or a desk that is not level.
    """
    fixed, other, beside = points
    along = other - fixed
    distance = float(norm(along))
    if not abs(distance - length) <= STRETCH:  # true for NaN
        raise CellError(
            f"register: the edges are {in_mm(distance, 1)} apart, the strip is"
            f" {in_mm(length, 1)} long; allowed: {in_mm(STRETCH)}; touch both"
            " edges again"
        )
    normal = np.cross(along, beside - fixed)
    if not norm(normal) >= OFF_LINE * distance:
        raise CellError(
            "register: the third point is too near the strip; allowed: at least"
            f" {OFF_LINE:.1f} m beside it; touch it again"
        )
    tilt = float(np.arccos(np.clip(abs(normal[2]) / norm(normal), 0.0, 1.0)))
    if not tilt <= MOST_TILT:
        raise CellError(
            f"register: the desk is tilted by {np.degrees(tilt):.2f} deg to the robot's"
            f" base, allowed {np.degrees(MOST_TILT):.1f} deg; level the desk or the"
            " robot"
        )
    x, y, z = fixed.tolist()
    yaw = float(np.arctan2(along[1], along[0]))
    return Mounting(x=round(x, 5), y=round(y, 5), z=round(z, 5), yaw=round(yaw, 5))


def write_mounting(configs: Configs, mounting: Mounting) -> Path:
    """Write `mounting`, which says where the robot stands, into the cell file, keep the
    old one there as a comment, and return the file's path.
    """
    path = configs.cell_path
    change_file(path, lambda text: _with_mounting(text, mounting, path))
    configs.cell()
    return path


def _with_mounting(text: str, mounting: Mounting, path: Path) -> str:
    """Text of the cell file with the new `mounting`, and with the old one as a comment
    at its end.
    """
    content = parse_yaml(text, str(path))
    old = parse(content, CellFile, str(path)).installation.mounting
    installation = content.get("installation", {}) | {"mounting": mounting.model_dump()}
    new = edit_yaml(text, content | {"installation": installation})
    date = datetime.now(UTC).date().isoformat()
    was = f"{{x: {old.x}, y: {old.y}, z: {old.z}, yaw: {old.yaw}}}"
    return f"{new.rstrip()}\n# until {date}: installation: mounting: {was}\n"
