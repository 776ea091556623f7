"""Folds of a plant whose rig is off, by a cell that has accepted it: they measure like any."""

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from cell.devices.devices import DeviceSelection
from cell.folding.replay import replay
from cell.folding.request import Recording
from tests.end_to_end.folded import Folded, fold_and_keep
from tests.support.requests import request_for

CONFIGS = Path(__file__).parents[2] / "configs"
Effects = Mapping[str, Mapping[str, float]]
RIG: dict[str, dict[str, float]] = {
    "tcp_offset": {"x": 0.004, "z": -0.003},
    "gripper_tilt": {"angle": 0.08},
    "desk_height": {"height": 0.002},
    "control_delay": {"time": 0.03},
    "camera_latency": {"time": 0.03},
    "homography_scale": {"scale": 0.008},
    "homography_shift": {"x": 0.004, "z": 0.0012},
    "contact_bias": {"bias": 0.004},
}


def affected(effects: Effects, folder: Path, *, accepted: bool = True) -> Folded:
    """A fold of denim on a rig with `effects`, which the cell file states or not."""
    configs = folder / "configs"
    shutil.copytree(CONFIGS, configs)
    if accepted:
        written(configs / "cell.yaml", effects)
    request = request_for("denim", "triangular", folder / "runs", configs, record=Recording("all"))
    plant = request.strip.model_copy(update={"effects": dict(effects)})
    choice = DeviceSelection(seed=3, plant=plant)
    return fold_and_keep(replace(request, choice=choice))


def written(path: Path, effects: Effects) -> None:
    content = yaml.safe_load(path.read_text()) | {"effects": dict(effects)}
    path.write_text(yaml.safe_dump(content))


def contact_errors(folded: Folded) -> np.ndarray:
    """contact_x measured minus true [m], where it is told well."""
    sights, truth = folded.run.sights(), folded.truth
    touch = folded.run.result.t_layer_touch
    told = (sights.stamp > 1.5) & (sights.stamp < touch - 0.2)
    true = np.interp(sights.stamp + folded.origin, truth.t, truth.contact_x)
    return (sights.contact_x - true)[told]


@pytest.mark.slow
def test_rig_that_is_off_in_every_known_way_measures_like_one_that_is_not(
    denim: Folded, tmp_path: Path
) -> None:
    folded = affected(RIG, tmp_path)
    result = folded.result
    assert result.outcome == "layer_touch"
    assert result.displacement == pytest.approx(result.displacement_true, abs=1e-3)
    assert result.displacement_true == pytest.approx(denim.result.displacement_true, abs=1.5e-3)
    assert np.abs(contact_errors(folded)).mean() < np.abs(contact_errors(denim)).mean() + 3e-4
    assert replay(Path(folded.result.run)).same


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tcp_offset", "homography_shift"])
def test_hidden_effect_shows(name: str, denim: Folded, tmp_path: Path) -> None:
    folded = affected({name: RIG[name]}, tmp_path, accepted=False)
    assert name != "homography_shift" or folded.result.outcome == "edges_apart"
    off = np.abs(contact_errors(folded)).mean() > np.abs(contact_errors(denim)).mean() + 1e-3
    missed = abs(folded.result.displacement - folded.result.displacement_true) > 2e-3
    assert off or missed
