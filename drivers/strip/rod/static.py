"""Static equilibria of a batch of strips, reached by damped motion along gripper
paths.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import SimulationNotConverged, Unsupported
from drivers.base.types import Array
from drivers.strip.model import StripModel, with_field
from drivers.strip.rod import layout as at
from drivers.strip.rod.batch import end_strips, flat_batch
from drivers.strip.rod.blocks import Output, step_along
from drivers.strip.rod.layout import Batch
from drivers.strip.rod.time_step import Pace

APPROACH_STEPS = 60  # steps from lying flat to where a strip hangs
FINE_STEPS = 150  # likewise, after the solver failed to converge in APPROACH_STEPS
APPROACH_HEIGHT = 0.7  # of the approach over the height that a slack strip allows
PERIOD = 0.05  # s, Euler steps of the approach
# s, steps in which a strip comes to rest
STILLING = tuple(PERIOD * 2**i for i in range(10))


def lift_path(batch: Batch, start: Array) -> Array:
    """Gripper path (k, n, 3) [m, m, rad] that lifts n flat strips to the gripper poses
    `start` (n, 3), in an arc that begins upwards.

    The height grows with the root of the inward distance, so that the edge stays within
    the strip's reach.
    """
    fraction = np.linspace(0.0, 1.0, APPROACH_STEPS + 1)[1:, None]
    path: Array = batch.grip + fraction[:, :, None] * (start - batch.grip)
    path[:, :, 1] = np.sqrt(fraction) * start[:, 1]
    return path


def fit_length(
    batch: Batch, models: Sequence[StripModel], steps: int = APPROACH_STEPS
) -> None:
    """Move the gripped edge of each strip of `batch` to x = its model's
    `stated_length`.

    A shorter strip is stretched evenly; a longer one, moved in `steps` steps, comes to
    rest with its slack as a wave in front of the grip, as after a grip that came in
    from above. Until then its ends do not slide and it is kept inextensible: fabric
    buckles, where a rod may stay straight and compressed.
    """
    grip = batch.grip
    slack = batch.arc[:, -1] - np.array([model.stated_length for model in models])
    is_short = slack < 0
    is_long = slack > 0
    goal = grip - slack[:, None] * (1.0, 0.0, 0.0)
    _stretch(batch, goal[:, 0] / grip[:, 0], is_short)
    grip[is_short] = goal[is_short]
    if is_long.any():
        rigid = batch._replace(nature=_rigid_nature(batch, models))
        settle(end_strips(rigid, ~is_long), _wave_path(batch, goal, slack, steps))
        yields = np.isfinite([model.mechanics.stretch_stiffness for model in models])
        settle(end_strips(batch, ~(is_long & yields)), goal[None])


def _wave_path(batch: Batch, goal: Array, slack: Array, steps: int) -> Array:
    """Gripper path (steps, n, 3) [m, m, rad] in an arc to `goal` (n, 3), low enough
    that the slack strips stay slack.

    A strip of length L with `slack` (n,) [m] s can be lifted to sqrt(L s / 2) in its
    middle.
    """
    fraction = np.linspace(0.0, 1.0, steps + 1)[1:, None]
    path: Array = batch.grip + fraction[:, :, None] * (goal - batch.grip)
    reach = np.sqrt(2 * batch.arc[:, -1] * np.maximum(slack, 0.0))
    path[:, :, 1] = APPROACH_HEIGHT * reach * np.sqrt(fraction * (1 - fraction))
    return path


def _rigid_nature(batch: Batch, models: Sequence[StripModel]) -> Array:
    """Coefficients, in the layout of `batch.nature`, of the same strips made
    inextensible and unable to slide.
    """
    stiff = [
        with_field(model, "mechanics.stretch_stiffness", np.inf) for model in models
    ]
    nature: Array = flat_batch(stiff, batch.arc.shape[1] - 1).nature
    if batch.terms:
        nature[:, :, [at.GRIPPED, at.CLING]] = np.inf
    return nature


def _stretch(batch: Batch, ratio: Array, stretched: NDArray[np.bool_]) -> None:
    """Scale x of all nodes by `ratio` (n,) in those of the n strips that the mask
    `stretched` (n,) selects.
    """
    states = batch.state
    ghost = states.shape[1] - 1  # beyond the grip: it keeps its distance
    for b, lane in np.ndindex(batch.strips.shape):
        i = batch.strips[b, lane]
        if i < len(ratio) and stretched[i]:
            state = states[b] if states.ndim == 3 else states[b, :, :, lane]
            state[ghost, at.X] -= (1.0 - ratio[i]) * state[ghost - 1, at.X]
            state[1:ghost, at.X] *= ratio[i]
            state[:, at.X1] = state[:, at.X]


def settle(batch: Batch, path: Array) -> None:
    """Move the grippers along `path` (k, n, 3) [m, m, rad] with damped steps, then let
    the n strips come to rest.
    """
    _follow_damped(batch, path, PERIOD)
    for longer in STILLING:
        _follow_damped(batch, path[-1:], longer)


def _follow_damped(batch: Batch, poses: Array, dt: float) -> None:
    """Step the strips along gripper `poses` (k, n, 3) [m, m, rad] by backward Euler;
    raises an error if one fails or its layers touch.
    """
    observed = np.zeros((len(poses), len(batch.grip), at.OBSERVABLE_COUNT))
    output = Output(observed, np.empty((0, 0, 0, 2)), every=1)
    step_along(batch, poses, output, Pace(start=0.0, h=dt, omega=0.0, next_omega=0.0))
    failed, touched = (
        np.isfinite(batch.monitor[:, field])
        for field in (at.FAILURE_TIME, at.TOUCH_TIME)
    )
    if failed.any():
        raise SimulationNotConverged("rod", int(np.argmax(failed)), time=0.0)
    if touched.any():
        i = int(np.argmax(touched))
        raise Unsupported(
            "rod", f"a start of strip {i} at which its layers touch before it rests"
        )
