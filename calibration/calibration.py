"""Camera calibration: lens, map to the strip's plane, and their quality, in one
file.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import Field, NonNegativeFloat

from calibration.homography import Homography, PlaneMap, Viewpoint, viewpoint
from calibration.lens import CameraFile, Lens, MatrixFile
from calibration.view import Landmarks
from drivers.base.errors import ConfigurationError
from drivers.base.files import write_file
from drivers.base.settings import VersionedFile, load
from drivers.base.yaml_text import dump_yaml

OPTIONAL_KEYS = ("contact_bias", "locks", "landmarks", "accepted_anyway")
KEYWORDS = ("residual_mm", "date", "camera", "latency", *OPTIONAL_KEYS)


@dataclass(frozen=True, slots=True)
class Calibration(PlaneMap):
    """Calibration of a camera at one pose: lens and map to the plane of the strip's
    near edge.

    `residual_mm` is the rms distance at touched points that the fit did not use,
    `latency` [s] how much earlier than its stamp an image shows the world,
    `contact_bias` [m] the additional offset of contact_x, `date` ISO 8601, `camera` the
    identity of its device, `locks` the locked control values, `landmarks` a picture
    that reveals a moved camera, `accepted_anyway` the reasons for which the wizard
    refused it, if it was accepted nevertheless. `id` is the hash of all of this but the
    date: calibrating the twin again gives the same id.
    """

    viewpoint: Viewpoint
    residual_mm: float
    latency: float
    date: str
    camera: str
    id: str
    contact_bias: float = 0.0
    locks: Mapping[str, int] = field(default_factory=dict)
    landmarks: Landmarks | None = None
    accepted_anyway: tuple[str, ...] = ()

    @property
    def residual(self) -> float:
        """Rms error [m] of the calibration at touched points that the fit did not
        use.
        """
        return 1e-3 * self.residual_mm


class CalibrationFile(VersionedFile):
    """Content of a calibration file; `lens` is a ROS camera_info mapping."""

    id: str
    camera: str
    date: str
    latency: float = 0.0
    residual_mm: NonNegativeFloat
    homography: MatrixFile
    lens: CameraFile
    contact_bias: float = 0.0
    locks: dict[str, int] = Field(default_factory=dict)
    landmarks: Landmarks | None = None
    accepted_anyway: tuple[str, ...] = ()

    def content(self) -> dict[str, Any]:
        """Content of the calibration file as a plain mapping for YAML, without empty
        values.
        """
        left_out = {key for key in OPTIONAL_KEYS if not getattr(self, key)}
        return self.model_dump(mode="json", by_alias=True, exclude=left_out)

    def calibration(self, origin: str) -> Calibration:
        """Calibration read from this file; ConfigurationError if it contradicts its
        id.
        """
        lens = self.lens.lens(f"{origin}: lens")
        homography = Homography.from_matrix(
            self.homography.array((3, 3), f"{origin}: homography")
        )
        expected = _digest(self.content())
        if self.id != expected:
            raise ConfigurationError(
                f"{origin}: id: is {self.id}, its contents say {expected}; "
                "the file was changed by hand, calibrate again"
            )
        return Calibration(
            lens=lens,
            homography=homography,
            viewpoint=viewpoint(lens, homography),
            id=self.id,
            **{name: getattr(self, name) for name in KEYWORDS},
        )


def make_calibration(lens: Lens, homography: Homography, **facts: Any) -> Calibration:
    """Create a calibration with an id; `facts` are its further values by name.

    `residual_mm`, `date` and `camera` are required.
    """
    return _signed_file(lens, homography, facts).calibration("calibration")


def change_calibration(calibration: Calibration, **facts: Any) -> Calibration:
    """Copy of `calibration` with changed `facts`, as `make_calibration` takes, and a
    new id.
    """
    values = {
        name: getattr(calibration, name) for name in ("lens", "homography", *KEYWORDS)
    }
    return make_calibration(**values | facts)


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write `calibration` to `path` atomically; ConfigurationError where that is not
    possible.
    """
    facts = {name: getattr(calibration, name) for name in KEYWORDS}
    file = _signed_file(calibration.lens, calibration.homography, facts)
    content = dump_yaml(file.content())
    write_file(path, content)


def load_calibration(path: Path) -> Calibration:
    """Read the calibration at `path`; ConfigurationError for a missing, broken or
    changed file.
    """
    if not path.exists():
        remedy = "name another, or make one with `cell calibrate homography --use`"
        raise ConfigurationError(f"{path}: there is no calibration; {remedy}")
    return load(path, CalibrationFile).calibration(str(path))


def _signed_file(
    lens: Lens, homography: Homography, facts: Mapping[str, Any]
) -> CalibrationFile:
    """Content of a calibration file from lens, map and `facts`, with the id of this
    content.
    """
    unsigned = CalibrationFile(
        schema=1,
        id="",
        homography=MatrixFile.from_array(homography.matrix),
        lens=CameraFile.from_lens(lens, facts["camera"]),
        **facts,
    )
    return unsigned.model_copy(update={"id": _digest(unsigned.content())})


def _digest(content: dict[str, Any]) -> str:
    """Id of a calibration: twelve digits of the hash of its `content` but for its
    date.
    """
    signed = {key: value for key, value in content.items() if key not in {"id", "date"}}
    return hashlib.sha256(json.dumps(signed, sort_keys=True).encode()).hexdigest()[:12]
