"""Required views of the board: place in the image, size, lean."""

from dataclasses import dataclass
from math import degrees

SMALL = 0.05  # share of the image within which a place is called the middle
FLAT = 0.05  # rad under which a lean is not spoken of


@dataclass(frozen=True, slots=True)
class WantedView:
    """A required view of the board, given by its image.

    `x`, `y` are its centre as fractions of the image, from the left and from the top, `size` its
    width as a fraction of the image's. Facing the camera at zero angles [rad]: `tilt` leans its top
    away, `turn` its right edge, `roll` turns it clockwise.
    """

    x: float
    y: float
    size: float
    tilt: float = 0.0
    turn: float = 0.0
    roll: float = 0.0

    def __str__(self) -> str:
        place = f"{_along(self.y, 'high', 'low')} {_along(self.x, 'left', 'right')}".split()
        where = " and ".join(word for word in place if word != "middle") or "the middle"
        leans = [
            _lean(self.tilt, "top away", "top nearer"),
            _lean(self.turn, "right edge away", "right edge nearer"),
            _lean(self.roll, "turned clockwise", "turned anticlockwise"),
        ]
        how = ", ".join(lean for lean in leans if lean) or "facing the camera"
        return f"{where}, {100 * self.size:.0f} % of the image wide, {how}"


def wanted_views(lean: float, sizes: tuple[float, float]) -> tuple[WantedView, ...]:
    """Thirteen views: five places, four leans, four leans with roll; `sizes` far and near.

    `lean` [rad] is the largest tilt.
    """
    far, near = sizes
    right, left, high, low = 0.84, 0.16, 0.27, 0.73
    return (
        WantedView(0.5, 0.5, near),
        WantedView(left, high, near, 0.5 * lean, 0.5 * lean),
        WantedView(right, low, near, -0.5 * lean, -0.5 * lean),
        WantedView(left, low, far, -0.5 * lean, 0.5 * lean),
        WantedView(right, high, far, 0.5 * lean, -0.5 * lean),
        WantedView(0.6, 0.5, far, tilt=lean, roll=0.1),
        WantedView(0.4, 0.5, far, tilt=-lean, roll=-0.1),
        WantedView(0.65, 0.5, near, turn=lean, roll=0.1),
        WantedView(0.35, 0.5, near, turn=-lean, roll=-0.1),
        WantedView(right, 0.5, near, 0.8 * lean, 0.8 * lean, 0.2),
        WantedView(left, 0.5, near, -0.8 * lean, -0.8 * lean, -0.2),
        WantedView(0.5, high, near, 0.8 * lean, -0.8 * lean, 0.3),
        WantedView(0.5, low, near, -0.8 * lean, 0.8 * lean, -0.3),
    )


def _along(share: float, low: str, high: str) -> str:
    if abs(share - 0.5) <= SMALL:
        return "middle"
    return low if share < 0.5 else high


def _lean(angle: float, positive: str, negative: str) -> str:
    if abs(angle) < FLAT:
        return ""
    return f"{positive if angle > 0 else negative} by {degrees(abs(angle)):.0f} deg"
