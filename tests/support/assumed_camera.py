"""A configuration with a real camera whose calibration is assumed, not measured."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import yaml

from calibration.calibration import Calibration, make_calibration, save_calibration
from calibration.homography import Homography
from calibration.lens import Lens
from drivers.v4l2.settings import V4l2Settings

CONFIGS = Path(__file__).parents[2] / "configs"
SEEN = 0.91  # m that the image shows in x, of a camera that looks straight at the plane


def configure(folder: Path, camera: V4l2Settings) -> None:
    """Copy the packaged configuration to `folder`, with `camera` and an assumed
    calibration.
    """
    plain = yaml.safe_load((CONFIGS / "cell.yaml").read_text())
    plain["camera"] = camera.model_dump(exclude_defaults=True)
    plain["calibration"] = "assumed.yaml"
    # s; an emulated processor is slow
    plain["monitors"] = {"arm_age": 0.5, "image_age": 1.0}
    plain["twin"]["world"] |= {"strip": False}  # no camera sees it
    (folder / "cell.yaml").write_text(yaml.safe_dump(plain))
    (folder / "strips").symlink_to(CONFIGS / "strips")
    save_calibration(_assumed(camera), folder / "assumed.yaml")


def _assumed(camera: V4l2Settings) -> Calibration:
    width, height = camera.width, camera.height
    metre = SEEN / width
    lens = Lens.pinhole((width, height), 2.5 * width, (width / 2, height / 2))
    upright = np.array([[metre, 0, -0.1], [0, -metre, 0.4], [0, 0, 1]])
    today = datetime.now(UTC).isoformat(timespec="seconds")
    return make_calibration(
        lens,
        Homography.from_matrix(upright),
        residual_mm=0.3,
        date=today,
        camera=camera.identity,
    )
