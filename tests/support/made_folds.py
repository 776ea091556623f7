"""Synthetic measured folds of a strip, with predictions and records of events."""

from functools import cache

import numpy as np

from cell.orchestrator.outcome import Outcome
from cell.orchestrator.recorder import Recorder
from cell.perception.model_agreement import MeasuredFold
from cell.perception.strip_measurement import SeenTouch, StripMeasurement
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from drivers.strip.rod.engine import Rod
from policies.path import triangular
from policies.policy import FoldPrediction, ParameterEstimate
from policies.profile import profiles
from tests.support.effect_cases import simulate

STRIP = StripFile(
    name="unknown",
    length=0.6,
    width=0.05,
    areal_density=0.3,
    bending_length=0.019,
    retardation_time=0.06,
    thickness=0.001,
)


BELIEF = FoldPrediction(
    displacement=0.0,
    sigma=0.001,
    bending_length=ParameterEstimate(0.019, 0.019 / 1.01, 0.019 * 1.01),
    retardation_time=ParameterEstimate(0.06, 0.06 / 1.3, 0.06 * 1.3),
    yield_curvature=ParameterEstimate(0.5, 0.0, 1.0),
    blind=False,
)


@cache
def measured(**effects: tuple[tuple[str, float], ...]) -> MeasuredFold:
    """Synthetic fold of the strip with `effects`, with the noise of images."""
    rng, path = np.random.default_rng(3), triangular(0.6, 0.04)
    t = np.arange(0.0, path.length / 0.1, 0.005)
    held = {name: dict(values) for name, values in effects.items()}
    model = describe(STRIP.model_copy(update={"effects": held}))
    rod = Rod(100)
    motion = simulate(rod, model, t, path.poses(0.1 * t), shapes=True)
    seen = slice(round(1.5 / 0.005), None, 3)
    arcs = np.broadcast_to(rod.arc()[0], (len(motion.t), rod.arc().shape[1]))
    curves = profiles(motion.shapes, arcs, motion.contact_x, motion.poses[:, :2])[seen]
    noise = rng.normal(size=curves.shape) * 0.0003 + rng.normal(size=(1, 1, 2)) * 0.0005
    return MeasuredFold.until(
        motion.touch.time, t, path.poses(0.1 * t), motion.t[seen], curves + noise
    )


TOUCH = SeenTouch(
    time=5.0, x=0.3, to_grasped=0.3, to_fixed=0.301, confidence=1.0, distance=0.001
)
OUTCOME = Outcome("layer_touch", "the layers touch", 0, TOUCH, -0.002, 14.0, BELIEF)


class Notes(Recorder):
    """Recorder that keeps its events in memory."""

    def __init__(self) -> None:
        self.events: list[tuple[str, dict[str, object]]] = []

    def event(self, clock: float, kind: str, **facts: object) -> None:
        self.events.append((kind, facts))


ANGLE = np.linspace(-np.pi / 2, np.pi / 2, 60)
ARCH = np.column_stack([0.28 + 0.011 * np.cos(ANGLE), 0.01 + 0.01 * np.sin(ANGLE)])
SEEN = StripMeasurement(1.0, 7, 0.28, 1.0, ARCH, 1.0, (0.291, 0.01), np.nan, np.nan)
