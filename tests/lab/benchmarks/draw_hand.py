"""Draws grasp, hanging and lay in the maker's model of arm and hand: `draw-hand OUT.png`.

The joints are those that the driver commands in a fold of denim. Renders with OpenGL;
without a screen set MUJOCO_GL=egl.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from matplotlib.figure import Figure

from drivers.base.types import Array, Image
from drivers.franka.obstacles import solids_of
from tests.support.franky_sim import franky_sim_model
from tests.support.maker_scene import MakerScene
from tests.support.planned_moments import Moment, plan

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
    figure = Figure(figsize=(9.6, 6.6), layout="constrained")
    columns = figure.subplots(2, 3).T
    for column, (title, moment) in zip(columns, moments(planned.fold()), strict=True):
        scene.place(moment.joints, moment.width, moment.midline)
        x, z, _ = moment.pose
        column[0].set_title(title)
        for axes, distance in zip(column, (WHOLE, CLOSE), strict=True):
            at = frame @ (x, 0.0, z + 0.05 * (distance == WHOLE), 1.0)
            axes.imshow(picture(scene, at[:3], distance))
            axes.set(xticks=[], yticks=[])
    figure.savefig(out, dpi=100)


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
