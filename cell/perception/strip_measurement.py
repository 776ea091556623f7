"""Values measured of a strip in one image, and of the touch of its layers in several
images.
"""

from dataclasses import KW_ONLY, dataclass
from math import nan

from drivers.base.types import Array
from drivers.strip.engine import Touch


@dataclass(frozen=True, slots=True)
class StripMeasurement:
    """Strip as measured in one image: lengths in m, NaN where hidden, and confidences
    from 0 to 1.

    `profile` (m, 2) is the visible midline from the desk contact to the gripper; `tip`
    the fold's rightmost point; `gap` the smallest visible vertical distance between the
    layers' midlines and `gap_x` its position, NaN before the upper layer begins to
    fall; `gripper` the arm's measured pose at the image's stamp.
    """

    stamp: float
    sequence: int
    contact_x: float
    contact_confidence: float
    profile: Array
    profile_confidence: float
    tip: tuple[float, float]
    gap: float
    gap_x: float
    gripper: tuple[float, float] = (nan, nan)

    @property
    def confidence(self) -> float:
        """Confidence in the measurement: the lower one of contact and profile."""
        return min(self.contact_confidence, self.profile_confidence)


@dataclass(frozen=True, slots=True)
class SeenTouch(Touch):
    """Layers' touch as measured in images, which do not show its `extension`.

    `confidence` is the agreement of its two signals, the closing gap and the stopping
    fold; `distance` [m] that of the midlines, the strip's thickness where it is not
    below 1 mm.
    """

    _: KW_ONLY
    confidence: float
    distance: float

    def facts(self) -> dict[str, float]:
        """Entries of result.yaml on the touch of the strip's layers, by name: time [s],
        lengths [m], confidence.
        """
        return {
            "t_layer_touch": self.time,
            "displacement": self.displacement,
            "l1": self.to_grasped,
            "l2": self.to_fixed,
            "confidence": self.confidence,
        }
