"""Draws grasp, hanging and lay in the maker's model of arm and hand: `draw-hand OUT.png`.

The joints are those that the driver commands in a fold of denim. Below, the desk's ends
as `drivers.franka.shapes` has them. Renders with OpenGL; without a screen set
MUJOCO_GL=egl.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drivers.base.types import Array, Image
from drivers.franka.obstacles import solids_of
from drivers.franka.shapes import (
    CLAMP,
    DESK_START,
    FINGER_WIDTH,
    MARK,
    NOTCH_LENGTH,
    NOTCH_WIDTH,
    PALM,
    RISE,
    TIP_AHEAD,
    block,
    boxes,
    finger,
    side_view,
)
from drivers.strip.file import StripFile
from tests.support.fold_moments import plan
from tests.support.franky_sim import franky_sim_model
from tests.support.maker_scene import MakerScene, Moment

SIZE = 480, 480  # px
CLOSE, WHOLE = 0.42, 1.5  # m from the camera to what it looks at


def main(out: Path) -> None:
    """Write the three moments, each whole and close, to the PNG file `out`."""
    with TemporaryDirectory() as runs:
        planned = plan("denim", Path(runs))
    scene = MakerScene(
        franky_sim_model(), solids_of(planned.installation), planned.strip
    )
    frame = planned.installation.mounting.transform().matrix
    figure = Figure(figsize=(9.6, 9.9), layout="constrained")
    columns = figure.subplots(3, 3).T
    drawn = moments(planned.fold())
    for column, (title, moment) in zip(columns, drawn, strict=True):
        scene.place(moment.joints, moment.width, moment.midline)
        x, z, _ = moment.pose
        column[0].set_title(title)
        for axes, distance in zip(column[:2], (WHOLE, CLOSE), strict=True):
            at = frame @ (x, 0.0, z + 0.05 * (distance == WHOLE), 1.0)
            axes.imshow(picture(scene, at[:3], distance))
            axes.set(xticks=[], yticks=[])
    (_, grasp), _, (_, lay) = drawn
    length = planned.strip.length
    draw_section(columns[0, 2], grasp, "desk's end, from the side [mm]", length)
    draw_notch(columns[1, 2], planned.strip)
    draw_section(columns[2, 2], lay, "fixed end, from the side [mm]", 0.0)
    figure.savefig(out, dpi=80)


def draw_section(axes: Axes, moment: Moment, title: str, end: float) -> None:
    """Draw desk, clamp, hand and strip of a `moment` about the desk's `end`, x [m]."""
    pose = moment.pose[None]
    parts = [finger(moment.width, side) for side in (-1.0, 1.0)]
    for part in (*parts, block(PALM)):
        axes.fill(*(1e3 * side_view(part, pose)[0].T), fc="#c9ccd1", ec="#44484f")
    length = float(moment.midline[:, 0].max()) if end else 0.6
    for box in boxes(end or length):
        if "beside" in box.name or box.name in ("floor", MARK.name):
            continue
        (x0, _, z0), (x1, _, z1) = 1e3 * np.array(box.low), 1e3 * np.array(box.high)
        style = {"ls": ":"} if "notch" in box.name else {"hatch": "//"}
        axes.fill(
            [x0, x1, x1, x0], [z0, z0, z1, z1], fc="#e8dcc3", ec="#8a7650", **style
        )
    axes.plot(*(1e3 * moment.midline.T), color="#2f6db5", lw=2)
    if end:
        axes.annotate("notch", (1e3 * end - 28, -25), fontsize=8)
    else:
        down = 1e3 * np.array(
            [(0.0, 0.0), (DESK_START, -0.002), (DESK_START, CLAMP[1])]
        )
        axes.plot(*down.T, color="#2f6db5", lw=2)
        axes.annotate("bar", (-13, -75), fontsize=8)
    axes.axhline(-1e3 * RISE, color="#8a7650")
    axes.annotate(f"{1e3 * RISE:.0f} mm of room", (1e3 * end - 85, -143), fontsize=8)
    axes.set(xlim=(1e3 * end - 90, 1e3 * end + 110), ylim=(-155, 130), title=title)
    axes.set_aspect("equal")


def draw_notch(axes: Axes, strip: StripFile) -> None:
    """Draw the desk's end with its notch and the `strip` from above, in mm."""
    end, half, deep = 1e3 * strip.length, 500 * NOTCH_WIDTH, 1e3 * NOTCH_LENGTH
    x = [end - 90, end, end, end - deep, end - deep, end, end, end - 90]
    y = [-70, -70, -half, -half, half, half, 70, 70]
    axes.fill(x, y, fc="#e8dcc3", ec="#8a7650", hatch="//")
    wide = 500 * strip.width
    edge = [end - 90, end, end, end - 90]
    axes.fill(edge, [-wide, -wide, wide, wide], fc="#2f6db5", alpha=0.4)
    reach, finger_half = 1e3 * TIP_AHEAD, 500 * FINGER_WIDTH
    hand = [end - reach, end + 45, end + 45, end - reach]
    sides = [-finger_half, -finger_half, finger_half, finger_half]
    axes.fill(hand, sides, fc="#c9ccd1", ec="#44484f")
    axes.annotate(f"{deep:.0f} x {2 * half:.0f} mm", (end - 84, 22), fontsize=8)
    axes.set(xlim=(end - 90, end + 60), ylim=(-75, 75), aspect="equal")
    axes.set_title("notch, strip and finger, from above [mm]")


def moments(fold) -> list[tuple[str, Moment]]:
    """The moments of a `fold` that are drawn, with their titles."""
    seen = list(fold)
    grasp = next(n for n, moment in enumerate(seen) if moment.held)
    lay = max(n for n, moment in enumerate(seen) if moment.held)
    upright = [n for n in range(grasp, lay) if seen[n].pose[2] > np.pi / 2 - 1e-3]
    return [
        ("the grasp: before the fingers close", seen[grasp - 1]),
        ("hanging", seen[upright[0]]),
        ("the lay: before the edge is let go", seen[lay]),
    ]


def picture(scene: MakerScene, at: Array, distance: float) -> Image:
    """Image of the `scene` from the camera's side, which looks `at` (3,) [m]."""
    camera = mujoco.MjvCamera()
    camera.lookat = at
    camera.distance = distance
    camera.azimuth, camera.elevation = 180.0, -8.0
    options = mujoco.MjvOption()
    options.geomgroup[3] = False  # the shapes for collision
    with mujoco.Renderer(scene.model, *SIZE) as renderer:
        renderer.update_scene(scene.data, camera, options)
        return renderer.render()
