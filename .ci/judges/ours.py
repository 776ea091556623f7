"""What the other programs are given, and what they must find in it.

    python .ci/judges/ours.py RUN OUT

Of the recorded fold RUN, and of strips, it writes to the folder OUT: `newton` and
`mjcf`, exported strips; `swing.npy`, how the rod swings that is let go from the flat;
`fold.npz`, how the twin's chain folds along the gripper's path in RUN; `path.npy`, a
path t, x, z of a gripper for the programs that write runs; `frames.npy`, stamps and
mean levels of the images that a policy sees.
"""

import sys
from pathlib import Path

import numpy as np

from cell.base.config.places import find_configs
from cell.record.run import Run, read_run
from cell.setup.strips.export_strip import export_strips
from drivers.strip.describe import describe
from drivers.strip.file import paper_strip
from drivers.strip.rod import layout as at
from drivers.strip.rod.batch import flat_batch
from drivers.strip.rod.blocks import Output, step_along
from drivers.strip.rod.time_step import Pace
from drivers.twin.chain.engine import Chain
from drivers.twin.settings import WorldSettings

SWING = paper_strip(
    0.1, 0.01, name="swing", length=0.2, bending_length=0.1, retardation_time=0.02
)
SEGMENTS, SWING_STEPS = 100, 1000
FOLD_STEP = 0.005  # s
BEFORE_TOUCH = 0.02  # s
EVERY = 50  # rows from one compared image to the next


def swing() -> np.ndarray:
    """Tip (100, 2) [m] of a rod without desk and grip, let go from the flat, each 10
    ms.
    """
    batch = flat_batch([describe(SWING)], SEGMENTS)
    batch.nature[:, :, at.DESK] = 0.0
    for field in (at.BEND, at.DAMP, at.SLIP, at.STICK):
        batch.nature[:, SEGMENTS + 1, field] = 0.0
    free = batch._replace(last=SEGMENTS + 1)
    shapes = np.full((SWING_STEPS // 10, *batch.arc.shape, 2), np.nan)
    observed = np.zeros((SWING_STEPS, 1, at.OBSERVABLE_COUNT))
    poses = np.repeat(batch.grip[None], SWING_STEPS, axis=0)
    step_along(free, poses, Output(observed, shapes, 10), Pace(0.0, 1e-3, 1.0, 1.0))
    return shapes[:, 0, -1]


def fold(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Commanded poses (k, 3) [m, m, rad] up to the touch, FOLD_STEP apart, and shapes
    (k, n, 2) [m] of the twin's chain along them.
    """
    touch = None if run.result is None else run.result.t_layer_touch
    if touch is None:
        raise SystemExit("wanting: a fold that ended with a touch")
    t = np.arange(0.0, touch - BEFORE_TOUCH, FOLD_STEP)
    ticks = run.ticks
    columns = (ticks.x_cmd, ticks.z_cmd, ticks.pitch_cmd)
    poses = np.stack([np.interp(t, ticks.t, column) for column in columns], axis=1)

    chain = Chain(WorldSettings().links)
    chain.reset([describe(find_configs(None).strip(run.header.strip))])
    shapes = [chain.shapes()[0]]
    for pose in poses[1:]:
        chain.step(pose[None], FOLD_STEP)
        shapes.append(chain.shapes()[0].copy())
    return poses, np.array(shapes)


def frames(run: Run) -> np.ndarray:
    """Stamps [s] and mean levels of the newest image in each fiftieth row, (2, n)."""
    rows = run.ticks.t[::EVERY]
    images = [(image.stamp, image.image.mean()) for image in run.film_frames()]
    stamps, levels = np.transpose(images)
    newest = np.maximum(np.searchsorted(stamps, rows, side="right") - 1, 0)
    return np.array([rows, levels[newest]])


def main() -> None:
    """Write all of it."""
    run, out = read_run(Path(sys.argv[1])), Path(sys.argv[2])
    export_strips([SWING], "newton", out / "newton")
    strip = find_configs(None).strip(run.header.strip)
    export_strips([SWING, strip], "mjcf", out / "mjcf")
    np.save(out / "swing.npy", swing())
    poses, shapes = fold(run)
    np.savez(out / "fold.npz", poses=poses, shapes=shapes)
    np.save(out / "frames.npy", frames(run))
    until = run.ticks.t < 3.0
    path = (run.ticks.t[until], run.ticks.x[until], run.ticks.z[until])
    np.save(out / "path.npy", np.array(path))


main()
