"""Accuracy of `cell observe --board` and `cell gap fit` on rendered films of a phone.

python -m tests.lab measure-phone OUT [--strips N] [--films N] [--seed S] [--every N]

Each strip has a hidden strong effect or none; each film of it a camera, lens, light,
hand and board of its own, and only every N-th image. Prints how far each run is from
the truth, and each verdict. Films that are in OUT are read again, and not rendered.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from calibration.board import BoardSettings
from cell.base.config.places import find_configs
from cell.folding.observe import FilmMeasurement, observe
from cell.gap.fit import fit
from cell.gap.rehearse import NO_EFFECT, is_right
from cell.gap.subject.strip.synthetic import Fold, rod_folds
from cell.record.film import FilmWriter
from cell.record.run import read_run
from drivers.base.errors import ConfigurationError
from drivers.base.types import Array, Image, Pose
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.file import StripFile
from drivers.strip.model import CONTACT_HEIGHT
from drivers.strip.shape import desk_contact
from drivers.twin.board import _draw_board
from drivers.twin.renderer.gripper import Outline, clip_above, draw_hand, faces_of
from drivers.twin.renderer.looks import BENCH, BLUE_MAT, GREY_DESK, Look, StripLook
from drivers.twin.renderer.optics import Optics, blur, noisy
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.renderer.stage import bgr
from drivers.twin.settings import CameraSettings
from drivers.twin.world import History, Scene
from tests.lab.exam.case import Case, Values
from tests.lab.exam.cases import draw_effects
from tests.lab.exam.from_state import ROD_STEP, SEGMENTS, paths_by_hand
from tests.support.seen_folds import distances

STANDING, BEGIN, AFTER = 1.0, 2.7, 0.4  # s: of the board, before the fold, after it
LEAVING = 0.9  # s in which the board is taken away
RATE = 30  # images a second
EMPTY_SHARE = 0.3  # of the strips, with nothing hidden
COLOURS = ((200, 40, 40), (30, 60, 180), (20, 20, 22), (230, 228, 220), (150, 40, 150))
SKINS = ((224, 172, 140), (141, 85, 60), (80, 50, 38))
# m along, across
ARM = np.array([(0.11, -0.035), (0.65, -0.045), (0.65, 0.045), (0.11, 0.035)])
FINGERS = np.array([(0.025, -0.016), (0.12, -0.036), (0.12, 0.036), (0.025, 0.016)])
AWAY = Pose(9.0, 9.0, 0.0)  # of the renderer's own gripper


class Phone:
    """Simulated phone camera before a `strip` that a hand holds by a clip, drawn from
    `rng`.
    """

    def __init__(self, strip: StripFile, rng: np.random.Generator) -> None:
        span = strip.length + rng.uniform(0.15, 0.3)
        camera = CameraSettings(
            width=1920,
            height=1080,
            rate=RATE,
            exposure=rng.uniform(0.004, 0.012),
            distance=span * rng.uniform(1.1, 2.2),
            elevation=np.radians(rng.uniform(1.7, 4.5)),
            view_width=span,
            aim_x=strip.length / 2 + rng.uniform(0.0, 0.03),
            aim_z=span * rng.uniform(0.20, 0.24),
            yaw=rng.uniform(-0.05, 0.05),
            tilt=rng.uniform(-0.02, 0.02),
            roll=rng.uniform(-0.04, 0.04),
            principal=tuple(rng.uniform(-15, 15, 2)),
            distortion=tuple(rng.uniform(-0.05, 0.03, 2)),
            lens_blur=0,
            noise=0,
            gain=rng.uniform(0.85, 1.05),
            light_gradient=rng.uniform(0.0, 0.2),
            shadow=rng.uniform(0.1, 0.35),
        )
        mats = {"desk": camera.surroundings.desk}, BLUE_MAT, GREY_DESK, BENCH
        mats = sorted(
            mats,
            key=lambda of: (
                np.dot(bgr(of["desk"]), bgr(strip.colour)) / np.linalg.norm(of["desk"])
            ),
        )
        # one of the two whose hue is least like the strip's
        hues = mats[rng.integers(2)]
        near = [strip.colour, hues["desk"]]
        *_, clamp, self._clip = sorted(
            COLOURS, key=lambda c: np.linalg.norm(np.subtract(near, c), axis=1).min()
        )
        self._skin = SKINS[rng.integers(len(SKINS))]
        self._camera, self._optics, self._rng = (
            camera,
            Optics.from_settings(camera),
            rng,
        )
        look = Look({**hues, "clamp": clamp})
        self._renderer = Renderer(camera, StripLook.from_file(strip), 1, surround=look)
        self._blur, self._noise = rng.uniform(0.8, 1.3), rng.uniform(1.5, 4.0)
        self._balance = (*rng.uniform(0.92, 1.08, 3), 1.0)
        self._floor = -strip.thickness / 2
        self._jaws = rng.uniform(0.0, 0.003), strip.width - rng.uniform(0.0, 0.008)
        self._size = rng.uniform(0.030, 0.045), rng.uniform(0.003, 0.005)
        self._stand, off = np.eye(4), rng.normal(0.0, np.radians(0.4), 3)
        self._stand[:3, :3] = cv2.Rodrigues(np.array([-np.pi / 2, 0.0, 0.0]) + off)[0]
        at = rng.uniform(0.18, strip.length - 0.18), rng.normal(0.0, 0.0015)
        self._stand[:3, 3] = *at, 0.098 + rng.uniform(0.014, 0.03)

    def film(self, fold: Fold, every: int) -> Iterator[tuple[float, Image]]:
        """Stamps [s] and images (h, w, 3) of a film of `fold`, every so many of
        them.
        """
        times, flat = (
            np.append(0.0, fold.shape_t),
            np.column_stack([fold.arc, 0 * fold.arc]),
        )
        scenes, end = History(times[1], times[-1]), float(times[-1])
        for t, points in zip(times, [flat, *fold.motion.shapes], strict=True):
            pose = Pose(
                *(float(np.interp(t, fold.path.t, of)) for of in fold.path.poses.T)
            )
            scenes.add(Scene(float(t), points, fold.arc, pose, 0.001, holds_strip=True))
        for number in range(round((BEGIN + end + AFTER) * RATE)):
            stamp = number / RATE
            if number % (every if stamp > BEGIN else min(every, 3)):
                continue
            moments = (
                stamp - BEGIN + self._camera.exposure * np.array([-1 / 3, 0, 1 / 3])
            )
            shown = [scenes.at(float(t)) for t in np.clip(moments, 0.0, end)]
            image = self._renderer.render([replace(s, gripper=AWAY) for s in shown], 0)
            self._draw_hand(image, shown[1].gripper)
            if stamp < STANDING + LEAVING:
                self._draw_board(image, max(stamp - STANDING, 0.0) / LEAVING)
            image = cv2.multiply(blur(image, self._blur), self._balance)
            yield stamp, noisy(image, self._noise, self._rng)

    def _draw_hand(self, image: Image, pose: Pose) -> None:
        (length, half), (near, far), low = self._size, self._jaws, self._floor
        cosine, sine = np.cos(pose.pitch), np.sin(pose.pitch)
        turn, (x, _, z) = (
            np.array([(cosine, sine), (-sine, cosine)]),
            self._optics.centre,
        )
        thin = np.array([(0.0, low), (length, low), (length, low - 0.0015)])
        jaws = [
            thin,
            np.array([(0.0, -low), (length, -low), (length, 2 * half), (0.0, half)]),
        ]
        hidden, seen = jaws if (x - pose.x, z - pose.z) @ turn[1] > 0 else jaws[::-1]
        for corners, front, back, colour in (
            (ARM, -0.01, 0.06, self._skin),
            (hidden, near, near, self._clip),
            (seen, near, far, self._clip),
            (FINGERS, -0.01, 0.0, self._skin),
        ):
            placed = corners @ turn + (pose.x, pose.z)
            outline = clip_above(placed, self._floor)
            box = (
                [Outline(outline, front, back, self._camera.gain)]
                if len(outline) > 2
                else []
            )
            draw_hand(image, box, faces_of(box, self._optics), (0, 0), bgr(colour))

    def _draw_board(self, image: Image, gone: float) -> None:
        """Draw the calibration board, which stands at `gone` 0, then tilts and leaves
        the image.
        """
        pose = self._stand.copy()
        turn = np.array(
            [1.1 * np.sin(np.pi * min(1.3 * gone, 1.0)), 0.3 * gone, 0.5 * gone]
        )
        pose[:3, :3] = cv2.Rodrigues(turn)[0] @ pose[:3, :3]
        pose[:3, 3] += (
            np.array([-0.1, -0.15, 0.25 + 0.6 * gone]) * gone * min(gone * 2, 1)
        )
        glow = np.full((*image.shape[:2], 1), np.float32(self._camera.gain))
        _draw_board(image, self._optics, BoardSettings().board(), pose, glow)


def render(
    strip: StripFile,
    hidden: dict[str, Values],
    seed: int,
    count: int,
    place: Path,
    every: int,
) -> list[Path]:
    """Render films of `strip` with `hidden` effects into `place`, each with its
    truth.
    """
    paths = paths_by_hand(strip.length, seed, count)
    models = [describe(strip, hidden, number) for number in range(count)]
    films = []
    for number, fold in enumerate(rod_folds(models, paths, SEGMENTS, ROD_STEP)):
        films.append(place / f"{number:02d}.mp4")
        phone = Phone(strip, np.random.default_rng([seed, number]))
        with FilmWriter(films[-1], "libx265") as film:
            for stamp, image in phone.film(fold, every):
                film.add(stamp, image)
        truth = {
            "path_t": fold.path.t,
            "poses": fold.path.poses,
            "shapes": fold.motion.shapes,
        }
        np.savez(films[-1].with_suffix(".npz"), t=fold.shape_t, **truth)
    return films


def errors(found: FilmMeasurement, film: Path) -> dict[str, float]:
    """Rms distances [mm] of a run's profile, contact and grip from the truth beside its
    `film`.
    """
    run, true = read_run(found.folder), np.load(film.with_suffix(".npz"))
    begin = BEGIN - found.begin

    def shape(stamp: float) -> Array:
        return np.asarray(true["shapes"][np.argmin(np.abs(true["t"] + begin - stamp))])

    ticks, t = run.ticks, np.minimum(run.ticks.t - begin, true["t"][-1])
    contacts = [
        x - desk_contact(shape(stamp), CONTACT_HEIGHT)
        for stamp, x in zip(
            np.asarray(ticks.contact_t), np.asarray(ticks.contact_x), strict=True
        )
        if np.isfinite(x) and stamp > begin
    ]
    grips = [
        seen - np.interp(t, true["path_t"], of)
        for seen, of in zip((ticks.x, ticks.z), true["poses"].T, strict=False)
    ]
    curves = [distances(points, shape(stamp)) for stamp, points in run.profile.curves()]
    off = {
        "curve": np.concatenate(curves),
        "contact": np.array(contacts),
        "grip": np.hypot(*grips),
    }
    return {
        name: 1e3 * float(np.sqrt(np.mean(values**2))) for name, values in off.items()
    }


def hide(strip: str, rng: np.random.Generator) -> dict[str, Values]:
    """Parameters of a strong effect of the strip, drawn as in the exam; empty for
    none.
    """
    if rng.uniform() < EMPTY_SHARE:
        return {}
    case = Case(
        name="phone",
        tier="state",
        kind="single",
        strip=strip,
        seed=1,
        motions="by_hand",
    )
    while True:
        hidden = draw_effects(case, 1, "strong", rng)
        if all(registry()[name].of == "strip" for name in hidden):
            return hidden


def measure(place: Path, strip: str, hidden: dict[str, Values]) -> dict[str, object]:
    """Read the films in `place`, fit their runs, and compare the verdict with what was
    hidden.
    """
    for film in sorted(place.glob("*.mp4")):
        try:
            found = observe(film, None, strip, place / "runs" / film.stem)
            print(film, found.read, "of", found.images, errors(found, film), flush=True)
        except ConfigurationError as error:
            print(error, flush=True)
    verdict = fit([place / "runs"], find_configs(None).strip_path(strip), place / "fit")
    outcome = {
        "strip": strip,
        "hidden": next(iter(hidden), NO_EFFECT),
        "verdict": verdict.verdict,
    }
    outcome |= {
        "named": [e.name for e in verdict.effects],
        "classes": verdict.ambiguous,
    }
    return {**outcome, "right": is_right(outcome)}


def main(
    out: Path, strips: int = 10, films: int = 10, seed: int = 1, every: int = 1
) -> None:
    """Render films of strips that are missing, measure all, and print the errors."""
    names = find_configs(None).strip_names()
    for number in range(seed, seed + strips):
        rng, place = np.random.default_rng(number), out / f"{number}"
        strip = find_configs(None).strip(names[rng.integers(len(names))])
        key = place / "hidden.json"
        if not key.exists():
            place.mkdir(parents=True, exist_ok=True)
            hidden = hide(strip.name, rng)
            render(strip, hidden, number, films, place, every)
            key.write_text(json.dumps(hidden))
        print(measure(place, strip.name, json.loads(key.read_text())), flush=True)
