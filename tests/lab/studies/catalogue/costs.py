"""Study of the cost of a fold's parts: image, measurement, decision, turn of the control loop.

Processor time of one thread where a part is called alone; a turn and the fold as a whole on the
wall clock, so that they need an idle machine.
"""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cell.config.places import find_configs
from cell.config.unknown import unknown_strip
from cell.devices.devices import DeviceSelection
from cell.folding.fold import fold
from cell.folding.request import Request
from cell.perception.layer_touch import LayerTouch
from cell.perception.perception import Perception
from cell.perception.preflight import inspect
from cell.perception.settings import PerceptionSettings
from cell.record.run import read_run
from drivers.strip.describe import describe
from drivers.twin.renderer.looks import LOOKS
from policies.adaptive.adaptive import Adaptive
from policies.adaptive.checkpoint import load_critic
from policies.adaptive.fabrics import plain
from policies.path import triangular
from policies.rollout import Rollout, roll_out
from policies.sensing import IMAGE_SENSING
from tests.lab.studies.kit.folds import cached_calibration
from tests.lab.studies.kit.rollouts import Kept, stepper
from tests.lab.studies.kit.sights import fold_of
from tests.lab.studies.kit.twin_fold import FoldCamera
from tests.lab.studies.study import Quantity, Statistic, Study, Values

IMAGES_BETWEEN = 6  # images from one that is measured to the next
FOLD_SPEED = 0.1  # m/s


def image_and_reading(seed: int, look: str) -> Mapping[str, list[float]]:
    """Times [ms] to render and to measure each image of a fold of denim in a look."""
    configs = find_configs(None)
    strip, camera = configs.strip("denim"), configs.cell().twin.camera
    settings, made = PerceptionSettings(), fold_of("denim", triangular(strip.length), FOLD_SPEED)
    twin = FoldCamera(strip, camera, seed, LOOKS[look])
    found = inspect(twin.flat(strip), cached_calibration(), settings, strip)
    if found.appearance is None:
        return {}
    perception = Perception(cached_calibration(), settings, strip, found.appearance)
    touch = LayerTouch(settings, strip)
    costs: dict[str, list[float]] = {"image": [], "reading": []}
    for sequence in range(IMAGES_BETWEEN, int(made.t[-1] * camera.rate), IMAGES_BETWEEN):
        pose, begun = made.pose(sequence / camera.rate), time.thread_time()
        frame = twin.frame(made, sequence)
        rendered = time.thread_time()
        touch.update(perception.look(frame, pose), pose)
        costs["image"].append(1e3 * (rendered - begun))
        costs["reading"].append(1e3 * (time.thread_time() - rendered))
    return costs


def decision(seed: int, _look: str) -> Mapping[str, list[float]]:
    """Times [ms] of each decision of `adaptive` in a fold from noisy states."""
    rng, kept = np.random.default_rng(seed), Kept(load_critic())
    strip = plain(rng)
    sensed = Rollout(sensing=IMAGE_SENSING)
    roll_out(kept, stepper("rod"), strip, [describe(strip)], settings=sensed, rng=rng)
    policy, costs = Adaptive(load_critic()), []
    policy.reset(unknown_strip("0.6"), FOLD_SPEED, 1)
    for seen, _ in kept.seen:
        begun = time.thread_time()
        policy.decide(seen)
        policy.prediction()
        costs.append(1e3 * (time.thread_time() - begun))
    return {"decision": costs}


def whole(seed: int, _look: str) -> Mapping[str, list[float]]:
    """Wall time of a fold and its record over its duration, and each turn of its loop [ms]."""
    calibration, choice = cached_calibration(), DeviceSelection(seed=seed)
    configs = find_configs(None)
    with TemporaryDirectory() as place:
        known = configs.cell(), configs.strip("denim"), "feedback", Path(place), choice
        result = fold(Request(*known), calibration=calibration)
        turns = 1e3 * read_run(Path(result.run)).costs()
    return {"turn": turns.tolist(), "fold": [result.wall / result.duration]}


COST_PARTS: dict[str, Callable[[int, str], Mapping[str, list[float]]]] = {
    "image and reading": image_and_reading,
    "decision": decision,
    "fold": whole,
}


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through parts of a fold, images through looks too."""
    seed, part = divmod(number, len(COST_PARTS))
    look = list(LOOKS)[seed % len(LOOKS)] if part == 0 else next(iter(LOOKS))
    return {"part": list(COST_PARTS)[part], "look": look, "noise": seed}


def measure(case: Values) -> Values:
    """Costs of the part of a fold that the case names, a list of numbers by name."""
    return COST_PARTS[case["part"]](case["noise"], case["look"])


STUDY = Study(
    name="costs",
    question="What do an image, its reading, a decision, a turn and a fold cost?",
    draw=draw,
    measure=measure,
    by=("part", "look"),
    quantities=(
        Quantity("image", Statistic.MEDIAN, "ms", 1.0, bar=8.0, label="image"),
        Quantity("reading", Statistic.MEDIAN, "ms", 1.0, bar=3.0, label="reading"),
        Quantity("decision", Statistic.MEDIAN, "ms", 1.0, bar=5.0, label="decision"),
        Quantity("turn", Statistic.MEDIAN, "ms", 1.0, label="turn"),
        Quantity("fold", Statistic.MEDIAN, "1", 1.0, bar=0.4, label="fold over its duration"),
    ),
    usual=36,
    quick=1,
    seconds=12.0,
)
