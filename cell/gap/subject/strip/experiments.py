"""Plans folds that could be measured next: standard motions, simulated for the stated strip."""

from collections.abc import Sequence

import numpy as np

from cell.gap.subject.strip.runs import FoldMeasurement, MeasuredRun
from cell.gap.subject.strip.smooth_and_thin import Images
from cell.gap.subject.strip.synthetic import Fold, reported_path, rod_folds
from cell.record.header import Sigma
from drivers.geometry import arc_lengths
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.observation import mean_force, reported_force
from drivers.strip.rod.engine import GripperPath
from drivers.strip.shape import desk_contact
from drivers.types import Array, frozen
from policies.experiments.standard import STANDARD
from policies.registry import MOTION

SET_UP = 1.5  # minutes to lay the strip flat again
IMAGE_PERIOD = 0.06  # s between images
POINT_SPACING = 0.015  # m between points of an image
SEGMENTS, STEP = 100, 0.005  # of the rod: a plan need not be finer


def planned_runs(strip: StripFile, sigma: Sigma, index: int) -> list[MeasuredRun]:
    """Simulated, noise-free run of `strip` for each standard motion, all with number `index`."""
    paths = [reported_path(standard.over(strip.length)) for standard in STANDARD.values()]
    return [
        MeasuredRun(name, MOTION + name, measured, ())
        for name, measured in zip(STANDARD, measured_along(paths, strip, sigma, index), strict=True)
    ]


def measured_along(
    paths: Sequence[GripperPath], strip: StripFile, sigma: Sigma, index: int
) -> list[FoldMeasurement]:
    """Simulated, noise-free measurements of `strip` along each of these gripper `paths`."""
    folds = rod_folds([describe(strip, index=index)] * len(paths), paths, SEGMENTS, STEP)
    return [_measure(fold, sigma, index) for fold in folds]


def minutes(run: MeasuredRun) -> float:
    """Duration [min] of a run in a laboratory, with laying the strip flat before it."""
    return SET_UP + run.measured.end / 60.0


def _measure(fold: Fold, sigma: Sigma, index: int) -> FoldMeasurement:
    """Noise-free measurements of a simulated fold, up to its touch."""
    path, touch = fold.path, fold.motion.touch
    end = float(path.t[-1]) if touch is None else touch.time
    travel = arc_lengths(path.poses[:, :2])
    observation = fold.model.observation
    height = observation.contact_height
    following = np.searchsorted(fold.shape_t, np.arange(fold.shape_t[0], end, IMAGE_PERIOD))
    chosen = np.unique(np.minimum(following, len(fold.shape_t) - 1))
    shapes, stamps = fold.motion.shapes[chosen], frozen(fold.shape_t[chosen])
    force_t = path.t[path.t <= end] if sigma.force is not None else np.empty(0)
    motion_force = mean_force(fold.motion.t, fold.motion.grip_force)
    force = reported_force(observation, force_t, fold.motion.t, motion_force)
    return FoldMeasurement(
        t=path.t, poses=path.poses, travel=frozen(travel), hanging=False, index=index,
        contact_height=height, sigma=sigma, contact_t=stamps,
        contact_x=frozen([desk_contact(shape, height) for shape in shapes]),
        images=_images(stamps, shapes, fold.arc, height),
        force_t=force_t, force=force, touch=touch, end=end,
    )  # fmt: skip


def _images(stamps: Array, shapes: Array, arc: Array, height: float) -> Images:
    """Images of simulated `shapes` (m, nodes, 2): their midline from the desk contact on."""
    s = np.arange(0.0, arc[-1], POINT_SPACING)
    points, places = [], []
    for shape in shapes:
        curve = np.stack([np.interp(s, arc, shape[:, c]) for c in range(2)], axis=1)
        lifted = s >= s[np.argmax(curve[:, 1] > height)]
        points.append(curve[lifted])
        places.append(s[lifted])
    image = np.repeat(np.arange(len(shapes)), [len(each) for each in points])
    return Images(stamps, frozen(np.concatenate(points)), image, frozen(np.concatenate(places)))


def instruction(run: MeasuredRun) -> str:
    """Instruction for the operator to make a planned run, with what the run reveals."""
    standard = STANDARD[run.name]
    return f"fold once more with --policy {run.condition}; it shows {standard.reveals}"


def next_index(runs: Sequence[MeasuredRun]) -> int:
    """Number of the run after the measured `runs`."""
    return 1 + max(run.measured.index for run in runs)
