"""Study of the accuracy of the homography wizard's latency."""

from dataclasses import replace
from math import isnan

import numpy as np

from calibration.wizard.touched_points import TouchedPoints
from cell.calibrating.calibrate import NO_STRIP, calibration_of
from cell.calibrating.keyboard import TwinOperator
from cell.calibrating.wizard import touch
from cell.config.places import find_configs
from cell.devices.devices import Devices, DeviceSelection
from cell.devices.twin import TwinCalibrationAids, twin_devices
from cell.orchestrator.context import CalibrationContext
from cell.orchestrator.operator import Unattended
from drivers.errors import Fault
from drivers.twin.open import open_twin
from tests.lab.studies.study import Quantity, Statistic, Study, Values

LATENCIES = (0.045, 0.0, 0.012, 0.110)  # s


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw the next camera latency."""
    noise, which = divmod(number, len(LATENCIES))
    return {"latency": LATENCIES[which], "noise": noise}


def measure(case: Values) -> Values:
    """Error [s] of the latency that the wizard measures, for a camera with a known one.

    Raises Fault where it measures none.
    """
    settings, late = find_configs(None).cell(), _late_twin(case["latency"], case["noise"])
    if late.aids is None:
        raise Fault("no_aids", "the twin has no hands")
    operator = TwinOperator(late.aids, Unattended())
    lens = calibration_of(settings).lens
    points = TouchedPoints(lens, settings.touches)
    context = CalibrationContext(settings.controller, points, operator)
    touch(late, context, lambda: False)
    if isnan(context.latency.latency):
        raise Fault("no_latency", "the wizard measured no latency")
    return {"off": context.latency.latency - case["latency"]}


def _late_twin(latency: float, seed: int) -> Devices:
    """A twin without a strip whose images show the world `latency` [s] before their stamps."""
    settings = find_configs(None).cell()
    plain = twin_devices(settings, NO_STRIP, DeviceSelection(seed=seed), calibrating=True)
    world = settings.twin.world.model_copy(update={"strip": False})
    bare = settings.twin.model_copy(update={"world": world})
    effects = {"camera_latency": {"time": latency}} if latency else {}
    twin = open_twin(bare, NO_STRIP, effects, seed, installation=settings.installation)
    aids = TwinCalibrationAids(twin, settings, seed)
    return replace(
        plain, clock=twin.clock, arm=twin.arm, hand=twin.hand, camera=twin.camera, aids=aids
    )


STUDY = Study(
    name="latencies",
    question="How exactly is the latency of a camera measured?",
    draw=draw,
    measure=measure,
    by=("latency",),
    quantities=(Quantity("off", Statistic.WORST_SIZE, "ms", label="worst |error|", bar=5.0),),
    usual=4,
    quick=1,
    seconds=30.0,
)
