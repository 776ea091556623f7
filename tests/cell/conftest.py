"""A made-up fold, written through the recorder: plausible curves, no physics."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calibration.calibration import Calibration, make_calibration, save_calibration
from calibration.homography import Homography
from calibration.lens import Lens
from cell.base.config.places import CHECKOUT_CONFIGS
from cell.perception.strip_measurement import StripMeasurement
from cell.record.files import CALIBRATION, Keep
from cell.record.truth import write_truth
from cell.record.writer import RunWriter
from drivers.base.readers import read_yaml
from drivers.base.types import Array, Frame, Image, Pose
from policies.path import triangular
from tests.support.effect_cases import DENIM
from tests.support.plain_cell import ARM
from tests.support.requests import CELL

LENGTH, SPEED = 0.6, 0.1
RESULT = read_yaml(Path(__file__).with_name("result.yaml"))
HEADER: dict[str, Any] = {
    "strip": "denim",
    "sigma": {
        "contact_x": 0.0012,
        "profile": 0.0008,
        "gripper": 0.0001,
        "displacement": 0.001,
    },
    "start": "flat",
    "speed": SPEED,
    "camera_hz": 60.0,
    "policy": "triangular",
    "seed": 7,
    "drivers": {"arm": "twin", "camera": "twin"},
    "plant_sha256": "9f2c" * 16,
    "versions": {"cell": "0.1.0", "python": "3.11"},
    "calibration": {"id": "made", "error": 0.00031},
    "strip_file": DENIM,
}


@pytest.fixture
def configs(tmp_path: Path) -> Path:
    """A copy of the configuration of the checkout."""
    return Path(shutil.copytree(CHECKOUT_CONFIGS, tmp_path / "configs"))


@pytest.fixture(scope="session")
def calibration() -> Calibration:
    """A camera 1.5 m before the strip, looking straight at it."""
    return straight_camera()


def straight_camera(**facts: object) -> Calibration:
    """The same outside of a test, with other `facts`."""
    scale = 1250.0 / 1.5
    to_image = np.array(
        [[scale, 0, 640 - 0.35 * scale], [0, -scale, 400 + 0.1 * scale], [0, 0, 1]]
    )
    known = {"residual_mm": 0.31, "date": "2026-01-01", "camera": "made"} | facts
    lens = Lens.pinhole((1280, 720), 1250.0, (640, 400))
    return make_calibration(
        lens, Homography.from_matrix(np.linalg.inv(to_image)), **known
    )


def profile(x: float, z: float, travel: float) -> Array:
    """A lifted strip from desk to gripper (40, 2)."""
    contact = max(LENGTH - 0.15 - 0.62 * travel, 0.2)
    s = np.linspace(0.0, 1.0, 40)[:, None]
    points = np.array([(contact, 0), (contact + 0.14, 0), (x + 0.04, 0.2 * z), (x, z)])
    basis = np.hstack([(1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s), s**3])
    return np.asarray(basis @ points)


def picture(calibration: Calibration, curve: Array, rng: np.random.Generator) -> Image:
    """The strip before a grey wall."""
    image = np.full((720, 1280, 3), (196, 200, 204), np.uint8)
    image[int(calibration.to_image(np.array([[0.0, -0.004]]))[0, 1]) :] = (
        118,
        128,
        138,
    )
    flat = np.array([[0.0, 0.0], *curve[:1]])
    for part in (flat, curve):
        pixels = np.rint(calibration.to_image(part)).astype(np.int32)
        cv2.polylines(image, [pixels], False, (100, 62, 44), 4, cv2.LINE_AA)
    u, v = np.rint(calibration.to_image(curve[-1:])).astype(int)[0]
    cv2.rectangle(image, (u - 9, v - 120), (u + 9, v + 2), (60, 60, 60), -1)
    tile = rng.integers(0, 6, (90, 160, 3), np.uint8)
    return cv2.add(image, np.tile(tile, (8, 8, 1)))


class MadeFold:
    """Writes a fold turn by turn into `writer`."""

    def __init__(
        self,
        writer: RunWriter,
        calibration: Calibration,
        seed: int = 0,
        pictures: bool = True,
    ) -> None:
        self.writer = writer
        self._pictures = pictures
        self._calibration = calibration
        self._rng = np.random.default_rng(seed)
        self._path = triangular(LENGTH)
        self._state = ""
        self._images = 0

    def run(self, until: float, image_every: int = 10) -> None:
        """All turns up to `until` [s], at 100 Hz."""
        for k in range(round(until * 100)):
            self.turn(0.01 * k)
            if k % image_every == 0:
                self.image(0.01 * k)

    def turn(self, t: float) -> None:
        travel = min(t * SPEED, 0.752)
        state = "LIFT" if travel < 0.14 else "FOLD" if t < 7.6 else "LAY"
        if state != self._state:
            self.writer.event(t, "state", state=state, event="made")
            self._state = state
        x, z, pitch = self._path.poses(travel)
        shake = self._rng.normal(0, 1e-4, 2)
        measured = Pose(x + shake[0], z + shake[1], float(pitch))
        self.writer.tick(
            replace(ARM, stamp=t, pose=measured, commanded=Pose(x, z, 0.0)), state
        )

    def image(self, t: float) -> None:
        x, z = self._path.at(min(t * SPEED, 0.752))
        curve = profile(float(x), float(z), t * SPEED)
        image = np.full((4, 6, 3), self._images, np.uint8)
        if self._pictures:
            image = picture(self._calibration, curve, self._rng)
        stamp, self._images = t - 0.021, self._images + 1
        self.writer.frame(Frame(stamp, t, "made", self._images, image))
        self.writer.sight(self._sight(stamp, curve))

    def _sight(self, stamp: float, curve: Array) -> StripMeasurement:
        seen = curve + self._rng.normal(0, 5e-4, curve.shape)
        right = int(np.argmax(seen[:, 0]))
        gap = float(seen[-1, 1]) if stamp > 5 else float("nan")
        tip = (float(seen[right, 0]), float(seen[right, 1]))
        contact = float(curve[0, 0] + self._rng.normal(0, 8e-4))
        return StripMeasurement(
            stamp, self._images, contact, 0.95, seen, 0.9, tip, gap, float(seen[-1, 0])
        )


Make = Callable[..., Path]


def made_run(root: Path, camera: Calibration, seconds: float) -> Path:
    """Folder of a short, complete run of the cell in `root`, seen by `camera`."""
    config = CELL.model_dump(mode="json", by_alias=True)
    writer = RunWriter(root, {**HEADER, "config": config}, "key", patient=True)
    save_calibration(camera, writer.folder / "calibration.yaml")
    writer.event(0.0, "origin")
    MadeFold(writer, camera, pictures=False).run(seconds)
    facts = {
        "sequence": 3,
        "x": 0.6,
        "z": 0.01,
        "time": 0.3,
        "direction": 1.5,
        "done": False,
    }
    writer.event(0.3, "decision", **facts)
    writer.finish({**RESULT, "t_layer_touch": seconds - 0.1})
    return writer.folder


@pytest.fixture(scope="session")
def make_run(calibration: Calibration) -> Make:
    """Writes a whole made-up run and returns its folder."""

    def make(
        root: Path, *, frames: Keep = "none", seed: int = 0, **result: Any
    ) -> Path:
        writer = RunWriter(root, HEADER, frames, patient=True)
        save_calibration(calibration, writer.folder / CALIBRATION)
        MadeFold(writer, calibration, seed, pictures=frames != "none").run(9.4)
        writer.finish({**RESULT, **result})
        write_truth(
            writer.folder, {"displacement": -0.0351, "t_layer_touch": 7.49, "plant": {}}
        )
        return writer.folder

    return make


@pytest.fixture(scope="session")
def finished(make_run: Make, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run with key frames; not to be changed."""
    return make_run(tmp_path_factory.mktemp("runs"), frames="key")


@pytest.fixture(scope="session")
def killed(calibration: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was left without a result in the middle of the fold; not to be
    changed.
    """
    root = tmp_path_factory.mktemp("killed")
    writer = RunWriter(root, HEADER, "key", patient=True)
    save_calibration(calibration, writer.folder / CALIBRATION)
    MadeFold(writer, calibration).run(4.3)
    writer.close()
    with (writer.folder / "ticks.arrows").open("r+b") as file:
        file.truncate(file.seek(0, 2) - 100)
    return writer.folder
