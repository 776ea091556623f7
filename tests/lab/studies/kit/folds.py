"""One fold through images on the twin, as a case of a study, and its prediction at the
touch.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from calibration.calibration import Calibration
from cell.base.config.cell import CellFile
from cell.base.config.places import find_configs
from cell.base.config.unmeasured_strip import unmeasured_name
from cell.base.devices.devices import Trial
from cell.folding.fold import fold
from cell.folding.request import Learning, RecordingOptions, Request, with_correction
from cell.folding.result import FoldResult
from cell.record.run import read_run
from cell.setup.calibration_in_use import calibration_of
from drivers.base.settings import parse
from drivers.strip.file import StripFile
from drivers.twin.renderer.looks import DEFAULT_LOOK
from drivers.twin.settings import TwinSettings
from policies.adaptive.critic import YIELD_UNIT
from tests.lab.studies.study import Quantity, Statistic, percentage

SPECIMEN_NAME = "studied"
UNRECORDED = RecordingOptions("none")


@cache
def cached_calibration() -> Calibration:
    """Calibration of the configured cell, made or read once a process."""
    return calibration_of(find_configs(None).cell())


def fold_strip(
    strip: str,
    policy: str,
    seed: int,
    folder: Path,
    *,
    plant: StripFile | None = None,
    cell: CellFile | None = None,
    calibration: Calibration | None = None,
    memory: Path | None = None,
) -> FoldResult:
    """Fold `strip` by `policy` on the twin of the configured or given `cell`.

    The record in `folder` is without images and page. With a `memory` the cell learns
    from it there, and all its folds are of one specimen.
    """
    request = _request(strip, policy, folder, memory, cell)
    request = replace(request, trial=Trial(plant=plant, seed=seed))
    request = with_correction(request, "off" if memory is None else "on")
    return fold(request, calibration or calibration_of(request.cell))


def _request(
    strip: str,
    policy: str,
    folder: Path,
    memory: Path | None,
    cell: CellFile | None = None,
) -> Request:
    configs, learning = find_configs(None), Learning(SPECIMEN_NAME, memory)
    known = cell or configs.cell(), configs.strip(strip), policy, folder / "runs"
    return Request(*known, record=UNRECORDED, learning=learning)


def cell_with_twin(
    look: str = DEFAULT_LOOK, camera: Mapping[str, float] = MappingProxyType({})
) -> CellFile:
    """The configured cell with another `look` and `camera` of its twin."""
    cell = find_configs(None).cell()
    content = cell.twin.model_dump(by_alias=True)
    content |= {"look": look, "camera": content["camera"] | camera}
    return cell.model_copy(update={"twin": parse(content, TwinSettings, "twin")})


def changed_since(strip: StripFile, memory: Path) -> str | None:
    """Run since which the cell reports a change in its folds of `strip`; None without a
    change.
    """
    name = unmeasured_name(strip.length, strip.thickness)
    request = with_correction(_request(name, "adaptive", memory, memory), "on")
    learned = request.learning.correction.learned
    return None if learned is None else learned.since


def fold_unknown(
    strip: StripFile,
    seed: int,
    folder: Path,
    *,
    measured: bool = True,
    memory: Path | None = None,
    thicker: float = 0.0,
    cell: CellFile | None = None,
) -> FoldResult:
    """Fold `strip` by `adaptive`, which knows its length, and its thickness if
    `measured`.

    The thickness is stated `thicker` [m] than it is; `memory` and `cell` as in
    `fold_strip`.
    """
    name = unmeasured_name(
        strip.length, strip.thickness + thicker if measured else None
    )
    return fold_strip(
        name, "adaptive", seed, folder, plant=strip, memory=memory, cell=cell
    )


def facts(result: FoldResult) -> Mapping[str, Any]:
    """Facts of a result for a study [m, s]: without paths and wall times, so that they
    repeat.
    """
    seen, true = result.displacement, result.displacement_true
    return {
        "outcome": result.outcome,
        "touched": seen is not None,
        "seen": seen,
        "true": true,
        "misread": difference(seen, true),
        "edges": result.edge_offset_true,
        "edges_misread": difference(result.edge_offset, result.edge_offset_true),
        "duration": result.duration,
    }


def difference(a: float | None, b: float | None) -> float | None:
    """a - b; None where one of them was not measured."""
    return None if a is None or b is None else a - b


SIGMAS_95 = 1.96  # sigmas of 95 %

QUANTITIES = (
    Quantity("true", Statistic.MEAN_SIZE, label="mean |d|"),
    Quantity("true", Statistic.P95_SIZE, label="95 % |d|"),
    Quantity("true", Statistic.WORST_SIZE, label="worst |d|"),
    Quantity("edges", Statistic.MEAN_SIZE, label="mean |edges|"),
    Quantity("edges", Statistic.WORST_SIZE, label="worst |edges|"),
    Quantity("surprise", Statistic.MEAN, label="d - predicted"),
    Quantity("surprise", Statistic.SIGMA, label="its sigma"),
    percentage("within_1", "within 1 sigma"),
    percentage("within_2", "within 1.96"),
    percentage("flagged", "flagged"),
)


def compare(result: FoldResult) -> Mapping[str, Any]:
    """Facts of a fold, the prediction [m], and the estimate of the strip behind it."""
    stored = read_run(Path(result.run)).result
    predicted = None if stored is None else stored.foretold
    agreed = None if stored is None else stored.agreement
    known = dict(facts(result)) | {
        "residual": agreed and agreed.residual,
        "yield_curvature": agreed and agreed.yield_curvature,
        "flagged": agreed is not None and not agreed.like_model,
    }
    true = result.displacement_true
    if predicted is None or true is None:
        return known
    surprise = true - predicted.displacement
    ratio = abs(surprise) / predicted.sigma
    return known | {
        "predicted": predicted.displacement,
        "sigma": predicted.sigma,
        "surprise": surprise,
        "within_1": ratio < 1.0,
        "within_2": ratio < SIGMAS_95,
        "believed_length": math.log(predicted.bending_length.value),
        "believed_time": math.log(predicted.retardation_time.value),
        "believed_friction": math.log1p(predicted.yield_curvature.value / YIELD_UNIT),
    }
