"""Strips, values and predictions that the tests of effects share."""

from pathlib import Path as FilePath
from typing import Any

import numpy as np

from drivers.base.readers import read_yaml
from drivers.base.types import Array
from drivers.strip.describe import describe
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Effect, Parameter
from drivers.strip.engine import Stepper, StripMotion
from drivers.strip.file import StripFile
from drivers.strip.model import StripModel
from drivers.strip.observation import true_path
from drivers.strip.rod.engine import GripperPath, Rod, simulate_all
from policies.path import Path, circular, triangular

LENGTH = 0.6
SPEED = 0.1
OBSERVED = ("contact_x", "holding_force", "grip_force")
EVERY = 20  # steps between shapes
PATHS = {"triangular": triangular(LENGTH), "circular": circular(LENGTH)}
# Values that the tests of today were written for; others follow from the role.
USUAL = read_yaml(FilePath(__file__).with_suffix(".yaml"))
DENIM: dict[str, Any] = {
    "schema": 1,
    "name": "denim",
    "length": LENGTH,
    "width": 0.05,
    "areal_density": 0.4,
    "bending_length": 0.017,
    "retardation_time": 0.03,
}
INDEX = 2  # runs that the specimen has been through before


def denim(**changes: Any) -> StripFile:
    """Strip of 0.6 m, about as heavy and stiff as denim."""
    return StripFile.model_validate(DENIM | changes)


def affected(name: str, strip: StripFile | None = None, **values: float) -> StripModel:
    """Model of a strip with the effect `name`, of the strip or of the cell."""
    own = {name: values} if registry()[name].of == "strip" else {}
    rig = {} if own else {name: values}
    affected = (strip or denim()).model_copy(update={"effects": own})
    return describe(affected, rig, INDEX)


def bare() -> StripModel:
    """Model of the strip without effects."""
    return describe(denim(), index=INDEX)


def usual(effect: Effect, parameter: Parameter) -> float:
    """Value of a parameter while another one of its effect is varied."""
    if parameter.name in USUAL:
        return USUAL[parameter.name]
    by_role = {"place": 0.5 * LENGTH, "width": 0.03, "time": 0.5, "ratio": 8.0}
    if parameter.role == "amount":
        return effect.sizes(denim())[-1]
    return by_role.get(parameter.role, 0.0)


def levels(effect: Effect) -> list[dict[str, float]]:
    """Low, middle and high of each parameter, the others as usual."""
    cases = []
    for parameter in effect.parameters:
        low, high = parameter.stated_range
        high = min(high, LENGTH) if parameter.name == "position" else high
        middle = np.sqrt(low * high) if low > 0 else (low + high) / 2
        rest = {
            p.name: usual(effect, p) for p in effect.parameters if p is not parameter
        }
        cases += [
            {**rest, parameter.name: float(value)} for value in (low, middle, high)
        ]
    return cases


def way(path: Path, speed: float = SPEED) -> GripperPath:
    """Path as a gripper record of 100 Hz, with smooth acceleration within 0.4 s."""
    t = np.arange(0.0, path.length / speed + 0.3, 0.01)
    share = np.clip(t / 0.4, 0.0, 1.0)
    travel = speed * np.where(t < 0.4, 0.4 * (share**3 - share**4 / 2), t - 0.2)
    return GripperPath(t, path.poses(np.minimum(travel, path.length)))


def folds(
    models: list[StripModel],
    path: str = "triangular",
    segments: int = 60,
    dt: float = 0.005,
) -> list[StripMotion]:
    """Simulated folds of the models along one path, in one batch of the rod."""
    ways = [way(PATHS[path])] * len(models)
    return simulate_all(Rod(segments), models, ways, dt=dt, every=EVERY)


def simulate(
    engine: Stepper,
    model: StripModel,
    t: Array,
    poses: Array,
    *,
    dt: float = 0.005,
    shapes: bool = False,
) -> StripMotion:
    """Simulate one strip along reported times `t` (m,) [s] and `poses` (m, 3), to its
    touch.
    """
    t, poses = true_path(model.rig, t, poses)
    engine.reset([model])
    elapsed = np.arange(dt, t[-1] - t[0] + 0.5 * dt, dt)
    path = np.stack(
        [np.interp(elapsed + t[0], t, column) for column in poses.T], axis=1
    )
    seen, curves = [], []
    for pose in path:
        seen.append(engine.step(pose[None], dt))
        curves += [engine.shapes()[0].copy()] if shapes else []
        if seen[-1].touch[0] is not None:
            break
    return StripMotion(
        t=elapsed[: len(seen)] + t[0],
        poses=path[: len(seen)],
        shapes=np.array(curves),
        touch=seen[-1].touch[0],
        **{
            name: np.array([getattr(step, name)[0] for step in seen])
            for name in OBSERVED
        },
    )


def fold(engine: Stepper, model: StripModel, path: str) -> StripMotion:
    """Simulated fold of the model along a named path, with its shapes."""
    along = way(PATHS[path])
    return simulate(engine, model, along.t, along.poses, shapes=True)
