"""What the twin's camera draws stands where its optics say, to fractions of a pixel."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from drivers.base.types import BoardPlacement as Placement, Pose
from drivers.twin.board import board_frame, board_pose
from drivers.twin.renderer.looks import StripLook
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.support.rendered_cell import empty, midline, scene

CLEAN = CameraSettings(noise=0.0, texture=0.0, shadow=0.0)
OPTICS = Optics.from_settings(CLEAN)
RED = (220, 40, 40)
SLIVER = 1e-6  # m of width: the cut edge and nothing behind it


def facing(centre: np.ndarray, tilt: float, turn: float, roll: float) -> np.ndarray:
    """Pose (4, 4) of a board at `centre` (x, y, z) [m] that stands upright in the cell
    frame.

    At zero angles [rad] its face is normal to -y; they lean it as in `Placement`.
    """
    upright = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    pose = np.eye(4)
    leaning = board_pose(CLEAN, board(), Placement(0.5, 0.5, 0.5, tilt, turn, roll))[
        :3, :3
    ]
    pose[:3, :3] = upright @ OPTICS.rotation @ leaning
    pose[:3, 3] = centre
    return pose


def difference(look: StripLook, scenes: list) -> np.ndarray:
    """How strongly the strip shows in each pixel: the image with it against the one
    without.
    """
    renderer = Renderer(CLEAN, look, seed=0)
    bare = [replace(s, strip=False) for s in scenes]
    with_strip, without = (
        renderer.render(s, 0).astype(np.float32) for s in (scenes, bare)
    )
    return np.abs(with_strip - without).sum(axis=-1)


def band(
    seen: np.ndarray, points: np.ndarray, reach: float = 5.0
) -> tuple[np.ndarray, np.ndarray]:
    """Offset of the band's centre from `points` (n, 2) [m] across the curve, and its
    sum [px].
    """
    centre = OPTICS.plane(points)
    along = np.gradient(centre, axis=0)
    normal = (
        np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.hypot(*along.T)[:, None]
    )
    offsets = np.arange(-reach, reach + 0.01, 0.1)
    places = (centre[:, None] + offsets[None, :, None] * normal[:, None]).astype(
        np.float32
    )
    values = cv2.remap(seen, places[..., 0], places[..., 1], cv2.INTER_LINEAR)
    return (values * offsets).sum(axis=1) / values.sum(axis=1), values.sum(axis=1) * 0.1


@pytest.mark.parametrize("thickness", [0.0003, 0.001, 0.002])
@pytest.mark.parametrize("kind", ["flat", "lifted", "high"])
def test_near_edge_is_centred_on_the_projected_midline(
    kind: str, thickness: float
) -> None:
    seen = difference(StripLook(RED, thickness, SLIVER), [scene(kind)])
    points, _ = midline(kind)
    shown = OPTICS.plane(points)[:, 1] > 10
    offsets, _ = band(seen, points[20:-20][shown[20:-20]])
    assert np.abs(offsets).mean() < 0.02
    assert np.abs(offsets).max() < 0.1


def test_motion_blur_leaves_the_near_edge_centred_on_the_middle_of_the_exposure():
    look = StripLook(RED, 0.001, SLIVER)
    moving = [scene("lifted", shift=(dx, 0.0)) for dx in (-0.001, 0.0, 0.001)]
    frames = [difference(look, scenes) for scenes in (moving[1:2], moving)]
    points = midline("lifted")[0][480:580:4]
    (still, still_sum), (blurred, blurred_sum) = (
        band(frame, points) for frame in frames
    )
    assert np.abs(blurred - still).mean() < 0.05
    assert blurred_sum.mean() == pytest.approx(still_sum.mean(), rel=0.03)
    u, v = OPTICS.plane(points).T.round().astype(int)
    assert frames[1][v, u].mean() < 0.75 * frames[0][v, u].mean()


@pytest.mark.parametrize(
    "place", [(0.05, 0.02), (0.31, 0.30), (0.6, 0.02), (0.62, 0.25)]
)
def test_pointer_disc_is_centred_on_the_gripper_point(
    place: tuple[float, float],
) -> None:
    renderer = Renderer(CameraSettings(noise=0.0), StripLook(RED, 0.001, 0.05), seed=0)
    image = renderer.render([empty(Pose(*place, np.pi / 2), pointer=True)], 0)
    u, v = OPTICS.plane(np.array(place))
    left, top = round(u) - 14, round(v) - 14
    bright = image[top : top + 29, left : left + 29].min(axis=-1).astype(float)
    share = np.clip(bright - 110, 0, None)
    dv, du = np.mgrid[0:29, 0:29]
    centre = np.array([(share * du).sum(), (share * dv).sum()]) / share.sum() + (
        left,
        top,
    )
    assert np.hypot(*(centre - (u, v))) < 0.05


def board() -> cv2.aruco.CharucoBoard:
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    return cv2.aruco.CharucoBoard((9, 7), 0.03, 0.022, words)


def test_board_corners_are_seen_where_the_optics_put_them() -> None:
    detector = cv2.aruco.CharucoDetector(board())
    rng = np.random.default_rng(0)
    errors = []
    for k in range(4):
        centre = np.array([0.31, -0.2, 0.16]) + rng.uniform(-0.1, 0.1, 3)
        pose = facing(centre, *rng.uniform(-0.6, 0.6, 3))
        frame = board_frame(CameraSettings(), board(), pose, seed=1, sequence=k)
        corners, ids, _, _ = detector.detectBoard(frame.image)
        assert len(ids) >= 40
        printed = board().getChessboardCorners()[ids.ravel()] - (0.135, 0.105, 0.0)
        errors.append(
            corners.reshape(-1, 2)
            - OPTICS.project(printed @ pose[:3, :3].T + pose[:3, 3])
        )
    seen = np.concatenate(errors)
    assert np.abs(seen.mean(axis=0)).max() < 0.03
    assert np.sqrt((seen**2).mean()) < 0.12
