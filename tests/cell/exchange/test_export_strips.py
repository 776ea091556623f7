"""A strip as other simulators take it: it hangs there as here, and what is lost is
told.
"""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cell.record.documents import write_document
from cell.setup.strips.export_strip import export_strips
from drivers.strip.cantilever import hanging_shape, hinges
from drivers.strip.file import StripFile, paper_strip
from tests.support.commands import invoke

FRICTION = {"bending_hysteresis": {"yield_curvature": 2.0, "stiffness_ratio": 8.0}}


def strip(**changes: object) -> StripFile:
    changes = {"length": 0.2, "bending_length": 0.1, "retardation_time": 0.1} | changes
    return paper_strip(0.1, 0.01, **changes)


def sag(made: StripFile, place: Path, lift: float = 0.0) -> float:
    """Height [m] of the free edge, five seconds after it was let go bent up by `lift`
    [rad].
    """
    [path] = export_strips([made], "mjcf", place)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = lift / model.nq
    while data.time < 5.0:
        mujoco.mj_step(model, data)
    assert model.body_mass.sum() == pytest.approx(made.mass)
    return float(data.site("grasped_edge").xpos[2])


def test_a_chain_of_mujoco_hangs_like_the_strip(tmp_path: Path) -> None:
    curled = strip(effects={"pre_curl": {"curvature": 3.0}})
    for made, rest in ((strip(), None), (curled, np.full(len(hinges(0.2)), 3.0))):
        expected = hanging_shape(0.2, 0.1, rest_curvature=rest).points[-1, 1]
        assert abs(sag(made, tmp_path / f"{expected}") - expected) < 2e-4


@pytest.mark.parametrize(
    ("effects", "low", "high"), [(FRICTION, 0.01, 0.1), ({}, 0.0, 1e-3)]
)
def test_friction_keeps_a_chain_on_its_side(tmp_path: Path, effects, low, high) -> None:
    made = strip(retardation_time=1.0, effects=effects)
    assert (
        low
        <= sag(made, tmp_path / "up", 1.0) - sag(made, tmp_path / "down", -2.0)
        <= high
    )


def test_a_rod_of_newton_says_what_it_cannot_and_when_its_yarns_slip(
    tmp_path: Path,
) -> None:
    path, out = tmp_path / "own.yaml", tmp_path / "out"
    made = strip(name="own", effects=FRICTION | {"air_drag": {"coefficient": 1.0}})
    write_document(path, made.model_dump(mode="json", by_alias=True))
    done = invoke(f"export {path} --format newton --out {out}")
    assert "not said: the air slows the strip" in done.stdout, done.output
    friction = json.loads((out / "own.json").read_text())["friction"]
    assert friction["yield_angle"] == pytest.approx(0.2 / 19.5 * 2.0 / 8.0)
