"""Hidden cause: a lens whose distortion changed after its calibration."""

from typing import ClassVar

from pydantic import Field

from tests.lab.exam.causes.cause import Cause


class LensTouched(Cause):
    """Adds `k1` and `k2` to the calibrated radial distortion of the lens.

    The exam does not draw it: up to a k1 of 0.25 the refitted base leaves nothing of it, and from
    0.3 on the preflight refuses to fold. At the edge of a picture r is about 0.19 here: k1 of
    0.1 moves it by some 2 px there. Source: Brown, Close-range camera calibration,
    Photogrammetric Engineering 37(8), 1971.
    """

    amount: ClassVar[str] = "k1"

    k1: float = Field(ge=-1, le=1)
    k2: float = Field(0.0, ge=-5, le=5)

    def distortion(self, distortion: tuple[float, float]) -> tuple[float, float]:
        """True radial distortion k1, k2 of the lens, given the calibrated `distortion`."""
        return distortion[0] + self.k1, distortion[1] + self.k2


CAUSE = LensTouched
