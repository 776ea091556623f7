"""What a fit hands on is loaded by MuJoCo alone, and moves there as it does here."""

import json
from pathlib import Path

import mujoco
import pytest
import yaml

from cell.gap.verdict.schema import Interval
from cell.interface.handover import export_fit
from cell.setup.strips.export_strip import export_strips
from drivers.base.files import write_file
from drivers.strip.describe import load_strip
from tests.support.commands import invoke
from tests.support.fit_folders import (
    Fitted,
    verdict_of,
    write_fit,
    write_mechanism_fit,
)
from tests.support.mechanisms import ARM, PRESCRIBED, make_arm, opened
from tests.support.refusals import refusal

MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MESHED = ARM.replace(
    "<worldbody>",
    """<asset><mesh name="m" file="meshes/m.obj"/></asset>
    <worldbody><geom type="mesh" mesh="m" mass="0"/>""",
)
FRICTION = {"torque_shoulder": 0.08, "torque_elbow": 0.05, "load_elbow": 0.01}
EFFECTS = {"dry_friction": FRICTION, "encoder_bias": {"bias_elbow": 0.01}}


def rub(plant: mujoco.MjModel) -> None:
    """Hide dry friction that holds the joints."""
    plant.dof_frictionloss[:] = 0.08, 0.05
    plant.dof_solimp[:, :2] = 0.9999


@pytest.fixture
def fit(tmp_path: Path) -> Path:
    """Fit of an arm with a mesh along its motion, which named EFFECTS."""
    file, runs = make_arm(tmp_path, 2, rub, PRESCRIBED)
    write_file(tmp_path / "meshes/m.obj", MESH)
    (tmp_path / "arm.xml").write_text(MESHED)
    arm = opened(file, runs)
    base = {p.name: p.start for p in arm.scope.base}
    write_mechanism_fit(tmp_path / "fit", file, arm, base, EFFECTS)
    return tmp_path / "fit"


def test_a_model_with_meshes_is_loaded_elsewhere_by_mujoco_alone(fit: Path) -> None:
    [(path, unsaid)] = export_fit(fit, "mjcf", fit / "out").items()
    (fit.parent / "meshes/m.obj").unlink()
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.dof_frictionloss.tolist() == [0.08, 0.05]
    assert unsaid[0] == "dry_friction: its load_elbow"


def test_a_mesh_that_changed_since_the_fit_is_not_handed_on(fit: Path) -> None:
    (fit.parent / "meshes/m.obj").write_text(MESH + "f 1 2 3")
    with refusal(r"m\.obj: has changed .*; fit again"):
        export_fit(fit, "mjcf", fit / "out")


def test_a_fit_of_an_older_version_says_how_to_fit_again(fit: Path) -> None:
    write_fit(fit, fit.parent / "arm.yaml", "accept", {"subject": "", "model": ""})
    with refusal(r"fit again: cell gap fit RUNS --model .*arm.yaml --out NEW"):
        export_fit(fit, "mjcf", fit / "out")


def test_replayed_runs_show_the_gap_before_and_after_and_what_is_not_said(
    fit: Path,
) -> None:
    [model] = export_fit(fit, "mjcf", fit / "out")
    runs, file = fit.parent / "runs", fit.parent / "arm.yaml"
    words = f"gap replay {runs} --model {file} --mjcf {model} --jobs 1 --json"
    done = invoke(words)
    assert "replay with the other model  50 %" in done.stderr
    found = json.loads(done.stdout)
    for key, noise in found["floor"].items():
        assert found["after"][key] < noise < 0.03 < found["before"][key]
    _, last = found["not_said"]
    assert last.startswith("encoder_bias: encoders read")


def test_a_strip_that_was_fitted_is_exported_as_its_patch(tmp_path: Path) -> None:
    effects = {"camera_latency": {"time": 0.01}}
    fit = Fitted(tmp_path / "fit", cell={"effects": effects}).out
    done = invoke(f"export {fit} --format mjcf --out {tmp_path / 'out'}")
    late = "the camera shows the world later than its time stamps say"
    assert late in done.stdout
    strip, again = load_strip(fit / "patch.yaml"), tmp_path / "again"
    [path] = export_strips([strip], "mjcf", again, [late])
    assert path.read_text() == (tmp_path / "out" / path.name).read_text()


def test_ranges_are_the_intervals_of_base_and_effects_with_their_units(
    tmp_path: Path,
) -> None:
    base = Interval(value=0.017, low=0.016, high=0.018, unit="m")
    slip = Interval(value=49.0, low=None, high=53.0, unit="1/m")
    effect = {"name": "friction", "of": "strip", "confidence": 0.9}
    effect["parameters"] = {"slip": slip}
    verdict = verdict_of(base={"length": base}, effects=[effect])
    made = Fitted(tmp_path / "fit")
    write_fit(made.out, made.file, made.kind, made.contents, verdict)
    [path] = export_fit(made.out, "ranges", tmp_path / "out")
    content = yaml.safe_load(path.read_text())
    assert content["subject"] == "denim.yaml"
    found = {row.pop("parameter"): row for row in content["ranges"]}
    assert found == {"length": base.model_dump(), "friction.slip": slip.model_dump()}
