"""Rendering of ChArUco boards in front of the twin's camera."""

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError
from drivers.base.types import Array, BoardPlacement, Frame, Image
from drivers.twin.renderer.optics import Optics, Pixels, axis_rotations, blur, noisy
from drivers.twin.renderer.stage import bgr, light
from drivers.twin.settings import CameraSettings

SOURCE = "twin board"
QUIET_ZONE = 0.5  # squares of white paper around the pattern
SAMPLES_PER_PIXEL = 2  # samples per pixel and direction
BORDER = 4  # px around the board that are redrawn with it
PRINT_SCALE = 2.5  # pixels of the print per pixel of the image
SMALLEST_SQUARE = 24.0  # px of the print
PAPER_LEVEL, INK_LEVEL = 232.0, 26.0  # grey levels of the print
DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)


def board_pose(
    settings: CameraSettings, board: cv2.aruco.CharucoBoard, placement: BoardPlacement
) -> Array:
    """Pose (4, 4) in the cell frame of `board`, held in front of the camera at
    `placement`.

    The board's frame has its origin at the centre, x to the right, y down, z into the
    board.
    """
    optics = Optics.from_settings(settings)
    distance = optics.focal * board.getChessboardSize()[0] * board.getSquareLength()
    distance /= placement.size * settings.width
    uv = np.array(
        [placement.x * settings.width, placement.y * settings.height], dtype=np.float32
    )
    ray = np.ravel(optics.rays(uv[:1], uv[1:])).astype(np.float64)
    about_x, about_y, about_z = axis_rotations(
        placement.tilt, placement.turn, placement.roll
    )
    pose = np.eye(4)
    pose[:3, :3] = optics.rotation.T @ (about_y.T @ about_x.T @ about_z)
    pose[:3, 3] = optics.centre + ray / (ray @ optics.rotation[2]) * distance
    return pose


def board_frame(
    settings: CameraSettings,
    board: cv2.aruco.CharucoBoard,
    pose: Array,
    seed: int,
    sequence: int,
) -> Frame:
    """Render the camera's image of `board` at rest at `pose` (4, 4) in the
    cell frame.

    Noise depends on `seed` and `sequence`. Raises ConfigurationError for a board that
    is behind the camera.
    """
    optics = Optics.from_settings(settings)
    image = np.empty((settings.height, settings.width, 3), np.uint8)
    glow = light(settings)[..., None]
    image[:] = bgr(settings.surroundings.backdrop) * glow
    _draw_board(image, optics, board, pose, glow)
    rng = np.random.default_rng((seed, sequence, 0xB0))
    pixels = noisy(blur(image, settings.lens_blur), settings.noise, rng)
    pixels.setflags(write=False)
    return Frame(
        stamp=0.0,
        arrival=settings.transport_delay,
        source=SOURCE,
        sequence=sequence,
        image=pixels,
    )


def _draw_board(
    image: Image,
    optics: Optics,
    board: cv2.aruco.CharucoBoard,
    pose: Array,
    glow: Pixels,
) -> None:
    """Draw `board` at `pose` (4, 4) into `image` (h, w, 3), in place."""
    # the sheet's corners in the cell
    square = board.getSquareLength()
    half = (np.array(board.getChessboardSize()) / 2 + QUIET_ZONE) * square
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half
    turn = pose[:3, :3]
    placed = np.column_stack([corners, np.zeros(4)]) @ turn.T + pose[:3, 3]

    depth = float(((placed - optics.centre) @ optics.rotation[2]).min())
    if depth <= 0:
        raise ConfigurationError(
            "board: pose: is behind the camera; hold the board before it"
        )

    # the part of the image that it covers
    pixels = optics.project(placed)
    size = image.shape[1::-1]
    first = np.floor(pixels.min(axis=0)).astype(int) - BORDER
    last = np.ceil(pixels.max(axis=0)).astype(int) + BORDER + 1
    left, top = np.clip(first, 0, size).tolist()
    right, bottom = np.clip(last, 0, size).tolist()
    if left >= right or top >= bottom:
        return

    u, v = np.meshgrid(_samples(left, right), _samples(top, bottom))
    x, y = _on_board(optics, pose, u, v)
    scale = max(PRINT_SCALE * optics.focal / depth * square, SMALLEST_SQUARE)
    levels, cover = _sample_print(board, x / square, y / square, round(scale))

    part = image[top:bottom, left:right]
    paper = levels[..., None] * glow[top:bottom, left:right]
    part[:] = np.minimum(part + cover[..., None] * (paper - part) + 0.5, 255)


def _samples(first: int, end: int) -> Pixels:
    """Pixel coordinates of the sampling points within the pixels from number `first` to
    before `end`.
    """
    counts = np.arange((end - first) * SAMPLES_PER_PIXEL)
    return ((counts + 0.5) / SAMPLES_PER_PIXEL - 0.5 + first).astype(np.float32)


def _on_board(
    optics: Optics, pose: Array, u: Pixels, v: Pixels
) -> tuple[Pixels, Pixels]:
    """Points x, y (h, w) [m] of the board, from its centre, that rays through the
    pixels `u`, `v` (h, w) meet.
    """
    turn = pose[:3, :3]
    directions = np.stack(optics.rays(u, v), axis=-1) @ turn.astype(np.float32)
    x0, y0, z0 = ((optics.centre - pose[:3, 3]) @ turn).tolist()
    reach = -z0 / directions[..., 2]
    return x0 + reach * directions[..., 0], y0 + reach * directions[..., 1]


def _sample_print(
    board: cv2.aruco.CharucoBoard, x: Pixels, y: Pixels, scale: int
) -> tuple[Pixels, Pixels]:
    """Grey levels (h, w) of the print, and the fraction of each pixel that it covers,
    at `x`, `y` [squares].
    """
    columns, rows = board.getChessboardSize()
    margin = round(QUIET_ZONE * scale)
    width = columns * scale + 2 * margin
    height = rows * scale + 2 * margin
    sheet = board.generateImage((width, height), marginSize=margin)
    u = (x + columns / 2) * scale + (margin - 0.5)
    v = (y + rows / 2) * scale + (margin - 0.5)
    grey = cv2.remap(sheet, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside = (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)

    level, cover = (_average(samples) for samples in (grey, inside))
    return INK_LEVEL + level * ((PAPER_LEVEL - INK_LEVEL) / 255), cover


def _average(samples: NDArray[np.generic]) -> Pixels:
    """Means (h, w) over the sampling points within each pixel."""
    height, width = (side // SAMPLES_PER_PIXEL for side in samples.shape)
    values = samples.astype(np.float32)
    means: Pixels = cv2.resize(values, (width, height), interpolation=cv2.INTER_AREA)
    return means
