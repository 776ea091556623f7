"""Draws the cell from the side and from above, with its axes: `draw-cell OUT.jpg`.

The side is an image of the twin in the middle of a fold, the plan is `installation` of
cell.yaml.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cell.base.config.places import find_configs
from drivers.strip.describe import load_strip
from drivers.twin.settings import CameraSettings
from policies.path import triangular
from tests.lab.studies.kit.twin_fold import FoldCamera, simulate_fold
from tests.support.seen_folds import STRIPS
from tests.support.twin_calibration import twin_calibration

MOMENT = 250  # number of the image
ARROW = {"arrowstyle": "<-", "lw": 2.0, "color": "white"}


def main(out: Path) -> None:
    """Write the drawing of the cell in both views to the JPEG file `out`."""
    strip, camera = load_strip(STRIPS / "denim.yaml"), CameraSettings(noise=0.5)
    fold = simulate_fold(strip, triangular(strip.length), 0.1)
    frame = FoldCamera(strip, camera).frame(fold, MOMENT)
    hand, to_image = fold.pose(frame.stamp), twin_calibration(camera).to_image
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    side, plan = figure.subplots(2, 1, height_ratios=(2.2, 1.0))
    side.imshow(frame.image[..., ::-1])
    side.set(title="what the camera sees", xticks=[], yticks=[])
    origin = to_image(np.zeros((1, 2)))[0]
    for name, end in {"x along the strip": (0.2, 0.0), "z upwards": (0.0, 0.2)}.items():
        side.annotate("", origin, to_image(np.array([end]))[0], arrowprops=ARROW)
        side.annotate(
            name,
            to_image(np.array([end]))[0],
            (2, 8),
            color="white",
            textcoords="offset points",
        )
    for name, place in {
        "clamp, at x = 0, z = 0": (-0.05, -0.05),
        "strip": (0.34, 0.15),
        "hand": (hand.x + 0.05, hand.z),
    }.items():
        side.annotate(name, to_image(np.array([place]))[0], color="white")
    mounting = find_configs(None).cell().installation.mounting
    along = np.array([np.cos(mounting.yaw), np.sin(mounting.yaw)])
    clamp, across = np.array([mounting.x, mounting.y]), np.array([along[1], -along[0]])
    edge, lens = (
        clamp + strip.length * along,
        clamp + 0.3 * along + camera.distance * across,
    )
    plan.plot(*np.array([clamp, edge]).T, lw=6, color="#2f6db5")
    for name, place in {
        "robot": (0.0, 0.0),
        "clamp": clamp,
        "grasped edge": edge,
        "camera": lens,
    }.items():
        plan.plot(*place, "ko", ms=5)
        plan.annotate(name, place, (8, 4), textcoords="offset points")
    plan.set(
        aspect="equal",
        xlabel="robot's x  [m]",
        ylabel="robot's y  [m]",
        title="from above",
    )
    plan.set(xlim=(-0.3, 2.8), ylim=(-0.5, 0.5))
    figure.savefig(out, dpi=100)
