"""Draws the cell from the side and from above, with its axes: `draw-cell OUT.jpg`.

The side is an image of the twin in the middle of a fold, the plan is `installation` of
cell.yaml.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cell.base.config.places import find_configs
from drivers.strip.describe import load_strip
from drivers.twin.settings import CameraSettings
from policies.path import triangular
from tests.lab.studies.kit.twin_fold import FoldCamera, TwinFold, simulate_fold
from tests.support.seen_folds import STRIPS
from tests.support.twin_calibration import twin_calibration

MOMENT = 250  # number of the image
ARROW = {"arrowstyle": "<-", "lw": 2.0, "color": "white"}


def main(out: Path) -> None:
    """Write the drawing of the cell in both views to the JPEG file `out`."""
    strip, camera = load_strip(STRIPS / "denim.yaml"), CameraSettings(noise=0.5)
    fold = simulate_fold(strip, triangular(strip.length), 0.1)
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    side, plan = figure.subplots(2, 1, height_ratios=(2.2, 1.0))
    draw_side(side, fold, camera)
    draw_plan(plan, strip.length, camera.distance)
    figure.savefig(out, dpi=100)


def draw_side(axes: Axes, fold: TwinFold, camera: CameraSettings) -> None:
    """Draw the camera's image in the middle of the `fold`, with its axes and names."""
    frame = FoldCamera(fold.strip, camera).frame(fold, MOMENT)
    axes.imshow(frame.image[..., ::-1])
    axes.set(title="what the camera sees", xticks=[], yticks=[])
    hand = fold.pose(frame.stamp)
    places = {
        "x along the strip": (0.2, 0.0),
        "z upwards": (0.0, 0.2),
        "clamp, at x = 0, z = 0": (-0.05, -0.05),
        "strip": (0.34, 0.15),
        "hand": (hand.x + 0.05, hand.z),
    }
    pixels = twin_calibration(camera).to_image(np.array([(0, 0), *places.values()]))
    for name, pixel in zip(places, pixels[1:], strict=True):
        axes.annotate(name, pixel, (2, 8), textcoords="offset points", color="white")
    for end in pixels[1:3]:
        axes.annotate("", pixels[0], end, arrowprops=ARROW)


def draw_plan(axes: Axes, length: float, distance: float) -> None:
    """Draw where robot, strip and camera stand, as `installation` says, from above."""
    mounting = find_configs(None).cell().installation.mounting
    along = np.array([np.cos(mounting.yaw), np.sin(mounting.yaw)])
    clamp, across = np.array([mounting.x, mounting.y]), np.array([along[1], -along[0]])
    edge, lens = clamp + length * along, clamp + 0.3 * along + distance * across
    axes.plot(*np.array([clamp, edge]).T, lw=6, color="#2f6db5")
    places = {"robot": 0.0 * clamp, "clamp": clamp, "grasped edge": edge}
    for name, place in {**places, "camera": lens}.items():
        axes.plot(*place, "ko", ms=5)
        axes.annotate(name, place, (8, 4), textcoords="offset points")
    axes.set(title="from above", aspect="equal", xlim=(-0.3, 2.8), ylim=(-0.5, 0.5))
    axes.set(xlabel="robot's x  [m]", ylabel="robot's y  [m]")
