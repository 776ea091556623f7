"""Simulated views of the calibration board by a lens model, without rendered images."""

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.board import BoardSettings, BoardView
from calibration.homography import Homography
from calibration.lens import Lens
from calibration.wizard.coverage import WantedView, wanted_views
from calibration.wizard.latency import LatencySteps
from drivers.base.types import Array

SIZE = (1280, 720)
LENS = Lens.pinhole(SIZE, 3413.0, (645.0, 355.0), (-0.18, 0.1))
AWAY = np.array([[1700.0, 0, 100], [0, -1700.0, 600], [0, 0, 1]])
MAP = Homography.from_matrix(np.linalg.inv(AWAY))


def projected(
    wanted: WantedView,
    rng: np.random.Generator,
    settings: BoardSettings,
    lens: Lens = LENS,
    noise: float = 0.05,
    bow: float = 0.0,
) -> BoardView:
    """Board view `wanted` projected by `lens`, corners with `noise` [px]; outside ones
    are missing.

    `bow` [m] is by how much the ends of the board bend away from its middle.
    """
    width = settings.width
    half = width / 2
    matrix = lens.matrix
    focal, principal = matrix[0, 0], matrix[:2, 2]
    board = np.asarray(settings.board().getChessboardCorners(), dtype=np.float64)
    centred = board - (half, settings.rows * settings.square / 2, 0)
    centred[:, 2] += bow * (centred[:, 0] / half) ** 2
    lean = Rotation.from_euler("YXZ", (-wanted.turn, -wanted.tilt, wanted.roll))
    turned = lean.apply(centred)
    depth = float(focal) * width / (wanted.size * lens.width)
    middle = np.multiply(lens.size, (wanted.x, wanted.y)) - principal
    seen = turned + np.append(middle / focal * depth, depth)
    ideal = seen[:, :2] / seen[:, 2:] * focal + principal
    image = lens.distort(ideal) + noise * rng.standard_normal((len(board), 2))
    inside = ((image > 4) & (image < np.subtract(lens.size, 4))).all(axis=1)
    return BoardView(np.flatnonzero(inside).astype(float), board[inside], image[inside])


def session(
    settings: BoardSettings,
    *,
    lean: float | None = None,
    noise: float = 0.05,
    seed: int = 0,
) -> dict[int, BoardView]:
    """All wanted views by number, with the largest tilt `lean` [rad] or the settings'
    own.
    """
    rng = np.random.default_rng(seed)
    leaning = settings.lean if lean is None else lean
    views = wanted_views(leaning, settings.sizes)
    return {
        k: projected(view, rng, settings, noise=noise) for k, view in enumerate(views)
    }


def bent_session(
    settings: BoardSettings, bow: float, seed: int
) -> dict[int, BoardView]:
    """All wanted views of a board bent by `bow` [m], through a camera drawn at
    random.
    """
    rng = np.random.default_rng(seed)
    focal = rng.uniform(2200, 4500)
    noise = rng.uniform(0.03, 0.15)
    centre = rng.uniform((625, 345), (655, 375))
    distortion = rng.uniform((-0.3, -0.1), (0.05, 0.2))
    lens = Lens.pinhole(SIZE, focal, centre, distortion)
    views = wanted_views(settings.lean, settings.sizes)
    return {
        k: projected(view, rng, settings, lens, noise, bow)
        for k, view in enumerate(views)
    }


def arm_steps(rng: np.random.Generator) -> Array:
    """Positions (1000,) [m] along x of smooth steps within 10 s, at 100 Hz."""
    t = np.arange(0.0, 10.0, 0.01)
    x = (
        0.25
        + 0.06 * (1 - np.cos(2 * np.pi * t / 1.5))
        + 2e-5 * rng.standard_normal(len(t))
    )
    return np.column_stack([t, x, np.full(len(t), 0.15)])


def steps_seen(
    arm: Array, stamps: Array, shown: Array, noise: float, rng: np.random.Generator
) -> LatencySteps:
    """Steps of the `arm` (n, 3) in images with `stamps` [s], each of the moment `shown`
    [s].

    The pointer's centre has `noise` [px].
    """
    x = np.interp(shown, arm[:, 0], arm[:, 1])
    pixels = LENS.distort(MAP.to_image(np.column_stack([x, np.full(len(x), 0.15)])))
    pixels = pixels + noise * rng.standard_normal(pixels.shape)
    return LatencySteps(
        arm=arm.tolist(), seen=np.column_stack([stamps, pixels]).tolist()
    )
