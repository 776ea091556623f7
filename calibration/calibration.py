"""What a camera calibration is: lens, map to the plane, how good they are, in one file."""

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field

from calibration.homography import Homography, Viewpoint, viewpoint
from calibration.lens import CameraFile, Lens, MatrixFile
from drivers.errors import ConfigurationError
from drivers.settings import Settings, load
from drivers.types import Array

NotNegative = Annotated[float, Field(ge=0)]


@dataclass(frozen=True, slots=True)
class Calibration:
    """One camera at one place, looking at the plane of the strip's near edge.

    `residual_mm` is the rms distance at touched points that the fit did not use, `latency` [s]
    how much earlier than its stamp an image shows the world, `contact_bias` [m] by how much
    contact_x is off besides, `date` ISO 8601, `camera` the identity of the device that it belongs
    to, `id` the hash of all of this but the date: calibrating the twin again gives the same id.
    """

    lens: Lens
    homography: Homography
    viewpoint: Viewpoint
    residual_mm: float
    latency: float
    date: str
    camera: str
    id: str
    contact_bias: float = 0.0

    def to_plane(self, pixels: Array) -> Array:
        """(n, 2) raw image points [px] -> (n, 2) x, z [m] in the plane of the near edge."""
        return self.homography.to_plane(self.lens.undistort(pixels))

    def to_image(self, points: Array) -> Array:
        """(n, 2) x, z [m] in the plane of the near edge -> (n, 2) raw image points [px]."""
        return self.lens.distort(self.homography.to_image(points))


class CalibrationFile(Settings):
    """The calibration as a file; `lens` is a ROS camera_info mapping."""

    schema_: Literal[1] = Field(1, alias="schema")
    id: str
    camera: str
    date: str
    latency: float
    residual_mm: NotNegative
    homography: MatrixFile
    lens: CameraFile
    contact_bias: float = 0.0

    def content(self) -> dict[str, Any]:
        """Plain mapping for YAML."""
        left_out = None if self.contact_bias else {"contact_bias"}
        return self.model_dump(mode="json", by_alias=True, exclude=left_out)

    def calibration(self, origin: str) -> Calibration:
        """The calibration; contents that do not match their id are a ConfigurationError."""
        lens = self.lens.lens(f"{origin}: lens")
        homography = Homography.of(self.homography.array((3, 3), f"{origin}: homography"))
        expected = _identity(self.content())
        if self.id != expected:
            raise ConfigurationError(
                f"{origin}: id: is {self.id}, its contents say {expected}; "
                "the file was changed by hand, calibrate again"
            )
        return Calibration(
            lens=lens,
            homography=homography,
            viewpoint=viewpoint(lens, homography),
            residual_mm=self.residual_mm,
            latency=self.latency,
            date=self.date,
            camera=self.camera,
            id=self.id,
            contact_bias=self.contact_bias,
        )


def calibrated(
    lens: Lens,
    homography: Homography,
    *,
    residual_mm: float,
    date: str,
    camera: str,
    latency: float = 0.0,
    contact_bias: float = 0.0,
) -> Calibration:
    """A calibration of its parts, with its id."""
    file = _file(
        lens,
        homography,
        residual_mm=residual_mm,
        latency=latency,
        date=date,
        camera=camera,
        contact_bias=contact_bias,
    )
    return file.calibration("calibration")


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write the file whole or not at all; a place that cannot be written is a ConfigurationError.

    The old file, if any, stays until the new one is complete.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    file = _file(
        calibration.lens,
        calibration.homography,
        residual_mm=calibration.residual_mm,
        latency=calibration.latency,
        date=calibration.date,
        camera=calibration.camera,
        contact_bias=calibration.contact_bias,
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("w", encoding="utf-8") as stream:
            yaml.safe_dump(file.content(), stream, sort_keys=False)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None


def load_calibration(path: Path) -> Calibration:
    """The calibration at `path`; missing, broken or changed files are a ConfigurationError."""
    if not path.exists():
        raise ConfigurationError(f"{path}: there is no calibration; run `cell calibrate` first")
    return load(path, CalibrationFile).calibration(str(path))


def _file(
    lens: Lens,
    homography: Homography,
    *,
    residual_mm: float,
    latency: float,
    date: str,
    camera: str,
    contact_bias: float,
) -> CalibrationFile:
    content = {
        "schema": 1,
        "id": "",
        "camera": camera,
        "date": date,
        "latency": latency,
        "residual_mm": residual_mm,
        "homography": MatrixFile.of(homography.matrix),
        "lens": CameraFile.of(lens, camera),
        "contact_bias": contact_bias,
    }
    unsigned = CalibrationFile.model_validate(content)
    return unsigned.model_copy(update={"id": _identity(unsigned.content())})


def _identity(content: dict[str, Any]) -> str:
    signed = {key: value for key, value in content.items() if key not in {"id", "date"}}
    return hashlib.sha256(json.dumps(signed, sort_keys=True).encode()).hexdigest()[:12]
