"""A film that begins with a printed board becomes a run; what it does not show is
named.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.board import BoardSettings
from cell.base.config.places import find_configs
from cell.folding.filmed_board import calibrate_film
from cell.folding.observe import observe
from cell.record.film import Film, FilmWriter
from cell.record.run import read_run
from drivers.base.errors import ConfigurationError
from drivers.base.types import Pose
from drivers.twin.board import _draw_board
from drivers.twin.renderer.optics import Optics
from drivers.twin.renderer.stage import light
from policies.path import triangular
from tests.lab.studies.kit.twin_fold import FoldCamera, TwinFold, simulate_fold
from tests.support.commands import refused
from tests.support.seen_folds import distances

CURVE, CONTACT = 2.0e-3, 3.0e-3  # m rms
# m along the strip from its end, and across it; of the renderer's own gripper
CLIP = np.array([(0.0, -0.001), (0.04, -0.001), (0.04, 0.009), (0.0, 0.005)])
PURPLE, AWAY = (150, 40, 150), Pose(9.0, 9.0, 0.0)
RATE, STANDING, LEAVING, BEGIN = 10, 1.0, 0.9, 2.7  # 1/s; s, of the board, of the fold


def board_pose(gone: float) -> np.ndarray:
    """Pose (4, 4) of a board that stands over the strip, then tilts and leaves."""
    pose = np.eye(4)
    turns = [(-np.pi / 2, 0.0, 0.0), (0.9 * gone, 0.3 * gone, 0.5 * gone)]
    upright, turn = (cv2.Rodrigues(np.array(angles))[0] for angles in turns)
    pose[:3, :3] = turn @ upright
    pose[:3, 3] = 0.3, 0.0, 0.12 + 0.4 * gone**2
    return pose


def clip_at(pose: Pose, optics: Optics) -> np.ndarray:
    """Outline (4, 2) [px] of the clip that holds the strip's end at `pose`."""
    cosine, sine = np.cos(pose.pitch), np.sin(pose.pitch)
    turn = np.array([(cosine, sine), (-sine, cosine)])
    return np.rint(optics.plane(CLIP @ turn + (pose.x, pose.z))).astype(np.int32)


def filmed(place: Path) -> tuple[Path, TwinFold]:
    """Film of a board that is taken away and of a fold, and that fold."""
    strip, settings = find_configs(None).strip("denim"), find_configs(None).cell()
    phone = settings.twin.camera.model_copy(update={"width": 1920, "height": 1080})
    camera = FoldCamera(strip, phone)
    fold = simulate_fold(strip, triangular(strip.length), 0.1)
    optics, board = Optics.from_settings(camera.settings), BoardSettings().board()
    film = place / "phone.mp4"
    with FilmWriter(film, "libx265") as writer:
        for number in range(int((BEGIN + fold.t[-1]) * RATE)):
            stamp = number / RATE
            since = max(stamp - BEGIN, 0.0)
            scene = fold.scene(since)
            image = camera.renderer.render([replace(scene, gripper=AWAY)], number)
            cv2.fillPoly(image, [clip_at(scene.gripper, optics)], PURPLE)
            if stamp < STANDING + LEAVING:
                pose = board_pose(max(stamp - STANDING, 0.0) / LEAVING)
                _draw_board(
                    image, optics, board, pose, light(camera.settings)[..., None]
                )
            writer.add(stamp, image)
    return film, fold


@pytest.mark.long
def test_a_film_of_a_board_and_a_fold_is_read_or_refused_by_name(
    tmp_path: Path,
) -> None:
    film, fold = filmed(tmp_path)
    strip = fold.strip
    frames = list(Film(film).frames())
    gone = [frame for frame in frames if frame.stamp > STANDING + LEAVING]
    fuchsia = strip.model_copy(update={"colour": (255, 0, 255)})
    short = strip.model_copy(update={"length": 0.97 * strip.length})
    refused = {
        "the printed board is not seen": (gone, strip),
        "the scene is never still": ([f for f in frames if f.stamp < STANDING], strip),
        "no strip of 600 mm": (frames, fuchsia),
        "mm long by the board": (frames, short),
    }
    for words, (shown, of) in refused.items():
        with pytest.raises(ConfigurationError, match=words):
            calibrate_film(film, iter(shown), BoardSettings(), of)
    found = observe(film, None, "denim", tmp_path / "run")
    run, begin = read_run(found.folder), BEGIN - found.begin
    off = [
        distances(points, fold.shape(stamp - begin))
        for stamp, points in run.profile.curves()
    ]
    contacts = [
        x - fold.contact_x(stamp - begin)
        for stamp, x in zip(run.ticks.contact_t, run.ticks.contact_x, strict=True)
        if stamp > begin
    ]
    assert np.sqrt(np.mean(np.concatenate(off) ** 2)) < CURVE
    assert np.sqrt(np.nanmean(np.square(contacts))) < CONTACT
    assert found.read > 10


@pytest.mark.parametrize("given", [(), ("--board --calibration calibration.yaml",)])
def test_a_film_is_calibrated_by_a_board_or_by_a_file(
    given: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = refused(monkeypatch, capsys, "observe film.mp4 --strip denim", *given)
    assert "either --board or --calibration" in text
