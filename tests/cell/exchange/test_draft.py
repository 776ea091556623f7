"""A mechanism's file and a mapping, drafted from a model and tables of other names, units
and signs, bring the signals back.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from cell.gap.subject.run_table import read_table
from drivers.base.readers import read_yaml
from drivers.base.types import Array
from tests.support.commands import invoke, refused
from tests.support.mechanisms import PRESCRIBED, make_arm

RANGES = {"shoulder": (0, 4095), "elbow": (200, 3900)}
GEAR = 50
COUNTS = 4095 / 360  # in a degree
NAMES = ("time_ms", "q_1", "q_2", "tau_1", "tau_2")
BY_JOINT = ("timestamp", "observation.shoulder.pos", "observation.elbow.pos",
            "current.shoulder", "current.elbow")  # fmt: skip


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the model `arm.xml` and two runs of it in SI units, in `runs`."""
    folder: Path = tmp_path_factory.mktemp("arm")
    make_arm(folder, 2, content=PRESCRIBED)
    return folder


def logs(arm: Path, place: Path, names: tuple[str, ...], scales: Array) -> list[Path]:
    """The runs as CSV files in `place`, whose columns have other names and scales."""
    made = []
    for run in sorted((arm / "runs").iterdir()):
        table = read_table(run / "signals.parquet")
        columns = [table[name] for name in ("t", "shoulder", "elbow", "t1", "t2")]
        made.append(place / f"{run.name}.csv")
        np.savetxt(made[-1], scales * np.array(columns).T, header=",".join(names),
                   comments="", delimiter=",")  # fmt: skip
    (place / "arm.xml").write_text((arm / "arm.xml").read_text())
    return made


def drafted(place: Path, *places: Path) -> str:
    """What the command prints that drafts robot.yaml and mapping.yaml in `place`."""
    given = (*places, "--model", place / "arm.xml", "--out", place / "mapping.yaml")
    return invoke("import", *given, "--guess").stdout


def test_units_signs_and_joints_are_told_by_ranges_and_the_models_torques(
    arm: Path, tmp_path: Path
) -> None:
    scales = np.array([1e3, 180 / np.pi, 180 / np.pi, -1e3, 1 / GEAR])
    tables = logs(arm, tmp_path, NAMES, scales)
    model = tmp_path / "arm.xml"
    model.write_text(model.read_text().replace('kp="30"', f'kp="30" gear="{GEAR}"'))
    drafted(tmp_path, *tables)
    invoke("import", *tables, "--mapping", tmp_path / "mapping.yaml", "--model",
           tmp_path / "robot.yaml", "--out", tmp_path / "runs")  # fmt: skip
    back = read_table(tmp_path / "runs" / "00" / "signals.parquet")
    stated = read_table(arm / "runs" / "00" / "signals.parquet")
    stated["t2"] = stated["t2"] / GEAR
    names = {"t1": "shoulder_torque", "t2": "elbow_torque", "elbow": "elbow"}
    for name, found in names.items():
        assert back[found] == pytest.approx(stated[name])
    signals = read_yaml(tmp_path / "robot.yaml")["signals"]
    assert signals["elbow_torque"]["side"] == "motor"


def test_what_cannot_be_told_is_open_and_calibrated_servos_turn_by_their_counts(
    arm: Path, tmp_path: Path
) -> None:
    spans = [(high - low) / COUNTS / 200 for low, high in RANGES.values()]
    of_range = np.degrees(1 / np.array(spans))
    tables = logs(arm, tmp_path, BY_JOINT, np.array([1, *of_range, 2, 2]))
    servos = tmp_path / "servos.json"
    content = {
        n: {"id": 1, "range_min": a, "range_max": b} for n, (a, b) in RANGES.items()
    }
    servos.write_text(json.dumps(content))
    assert "about 0.5 by the model's torques" in drafted(tmp_path, *tables, servos)
    (signals,) = read_yaml(tmp_path / "mapping.yaml")["signals"]
    columns = signals["columns"]
    assert columns["elbow_torque"]["factor"] is None
    assert columns["elbow"]["factor"] == pytest.approx(spans[1], rel=1e-5)


def test_a_set_without_torques_is_simulated_under_its_commands(
    arm: Path, tmp_path: Path
) -> None:
    names = "t", "state.shoulder", "state.elbow", "action.shoulder", "action.elbow"
    drafted(tmp_path, *logs(arm, tmp_path, names, np.ones(5)))
    robot = read_yaml(tmp_path / "robot.yaml")
    assert robot["inputs"] == {"a1": "ctrl", "a2": "ctrl"}


def test_tables_without_a_joint_of_the_model_are_refused_with_both_names(
    arm: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    tables = logs(arm, tmp_path, ("t", "a", "b", "c", "d"), np.ones(5))
    given = (*tables, "--model", tmp_path / "arm.xml", "--guess")
    error = refused(monkeypatch, capsys, "import", *given)
    assert "joints: shoulder, elbow; columns: t, a" in error
