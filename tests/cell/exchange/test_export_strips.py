"""A strip as other simulators take it: it hangs there as here, and what is lost is told."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from cell.cli.app import app
from cell.strips.export_strip import export_strips
from drivers.strip.cantilever import hang, hinges
from drivers.strip.file import StripFile, paper_strip

STIFF = {"length": 0.2, "bending_length": 0.1, "retardation_time": 0.1}
FRICTION = {"bending_hysteresis": {"yield_curvature": 2.0, "stiffness_ratio": 8.0}}


def strip(**changes: object) -> StripFile:
    return paper_strip(0.1, 0.01, **STIFF | changes)


def sag(made: StripFile, place: Path, lift: float = 0.0) -> float:
    """Height [m] of the free edge after five seconds, from rest or from far above it."""
    [path] = export_strips([made], "mjcf", place)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    assert model.body_mass.sum() == pytest.approx(made.mass)
    data.qpos[:] = lift / model.nq
    while data.time < 5.0:
        mujoco.mj_step(model, data)
    return float(data.site("grasped_edge").xpos[2])


@pytest.mark.parametrize("curvature", [0.0, 3.0])
def test_a_chain_of_mujoco_hangs_like_the_strip(tmp_path: Path, curvature: float) -> None:
    made = strip(effects={"pre_curl": {"curvature": curvature}} if curvature else {})
    rest = np.full(len(hinges(0.2)), curvature)
    expected = hang(0.2, 0.1, rest_curvature=rest).points[-1, 1]
    assert sag(made, tmp_path / "out") == pytest.approx(expected, abs=2e-4)


def test_friction_keeps_a_chain_on_the_side_from_which_it_came(tmp_path: Path) -> None:
    made = strip(retardation_time=1.0, effects=FRICTION)
    low, high = (sag(made, tmp_path / f"{lift}", lift) for lift in (-2.0, 1.0))
    assert high - low > 0.01
    made = made.model_copy(update={"effects": {}})
    assert sag(made, tmp_path / "up", 1.0) - sag(made, tmp_path / "down", -2.0) < 0.001


def test_a_rod_of_newton_has_stiffness_mass_and_yield_angle_of_a_joint(tmp_path: Path) -> None:
    effects = FRICTION | {"air_drag": {"coefficient": 1.0}}
    [(path, unsaid)] = export_strips([strip(effects=effects)], "newton", tmp_path / "out").items()
    found, span = json.loads(path.read_text()), 0.2 / 60
    assert len(found["add_rod"]["positions"]) == 61
    assert found["add_rod"]["bend_stiffness"] == pytest.approx(strip().rigidity / span)
    assert found["add_rod"]["bend_damping"] == pytest.approx(strip().rigidity / span * 0.1)
    assert found["friction"]["yield_angle"] == pytest.approx(span * 2.0 / 8.0)
    assert found["not_said"] == list(unsaid)
    assert any("air" in sentence for sentence in unsaid)


def test_command_writes_a_strip_and_tells_what_is_lost(tmp_path: Path) -> None:
    words = ["export", "denim", "--format", "mjcf", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "not said: twist" in done.stdout
    assert (tmp_path / "out" / "denim.xml").is_file()
