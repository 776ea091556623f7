import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from cell.record.run import read_run
from cell.record.truth import read_truth
from drivers.base.errors import ConfigurationError
from tests.support.refusals import refusal
from tests.support.run_edits import edit_yaml

SIGMA = {"contact_x": 1e-3, "profile": 1e-3, "gripper": 1e-4, "displacement": 1e-3}


def columns(n: int = 50) -> dict[str, np.ndarray]:
    t = np.arange(n) * 0.01
    still = np.full(n, 0.1)
    contact = np.where(np.arange(n) % 5 == 0, 0.4, np.nan)
    return {
        "t": t,
        "x": still,
        "z": still,
        "pitch": still,
        "x_cmd": still,
        "z_cmd": still,
        "contact_x": contact,
    }


@pytest.fixture
def laboratory(tmp_path: Path) -> Path:
    """A run written by hand: the four files and nothing else."""
    header = {"schema": 1, "strip": "denim", "sigma": SIGMA, "operator": "Ada"}
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(header))
    change(tmp_path, "ticks.parquet")
    points = {"t": [0.0, 0.0, 0.1, 0.1], "i": [0, 1, 1, 0], "x": [0.1, 0.2, 0.4, 0.3]}
    change(tmp_path, "profile.parquet", **points, z=[0.0, 0.1, 0.1, 0.0])
    (tmp_path / "result.yaml").write_text(
        yaml.safe_dump({"outcome": "path_done", "mood": "good"})
    )
    return tmp_path


def change(folder: Path, file: str, **values: object) -> None:
    if file.endswith(".yaml"):
        edit_yaml(folder / file, **values)
        return
    table = {**columns(), **values} if file == "ticks.parquet" else values
    table = {k: v for k, v in table.items() if v is not None}
    pq.write_table(pa.table(table), folder / file)


def test_run_written_by_hand_is_read(laboratory):
    change(laboratory, "ticks.parquet", mood=np.zeros(50))
    run = read_run(laboratory)
    assert (run.header.model_extra["operator"], run.result.model_extra["mood"]) == (
        "Ada",
        "good",
    )
    assert run.header.strip == "denim"
    assert run.header.start == "flat"
    assert run.header.contact_height == 0.001
    assert run.ticks.t.size == 50
    assert np.isnan(run.ticks.f_x).all()
    assert run.result.outcome == "path_done"
    assert not run.died
    assert run.events() == ()
    assert run.sights().stamp.size == 0
    assert list(run.frames()) == []
    assert run.calibration() is None
    assert read_truth(laboratory) is None


def test_profiles_alone_count_as_reliable_measurements(laboratory) -> None:
    found = read_run(laboratory).measurements()
    assert [seen.profile_confidence for seen in found] == [1.0, 1.0]


BROKEN = [
    ("run.yaml", {"strip": None}, "run.yaml: strip: is missing"),
    ("run.yaml", {"sigma": {**SIGMA, "profile": 0}}, "run.yaml: sigma.profile"),
    ("run.yaml", {"start": "upside"}, "run.yaml: start"),
    ("run.yaml", {"schema": 2}, "schema: is 2, this version reads 1"),
    ("result.yaml", {"outcome": None}, "result.yaml: outcome: is missing"),
    ("result.yaml", {"outcome": "layer_touch"}, "needs t_layer_touch"),
    ("ticks.parquet", {"z": None}, "ticks.parquet: z: the column is missing"),
    ("ticks.parquet", {"x": np.full(50, np.nan)}, "ticks.parquet: x: row 0 is nan"),
    ("ticks.parquet", {"t": np.zeros(50)}, "ticks.parquet: t: row 1"),
    ("ticks.parquet", {"x": np.full(50, 600.0)}, "ticks.parquet: x: reaches 600"),
    ("ticks.parquet", {"pitch": np.full(50, 90.0)}, "ticks.parquet: pitch: reaches 90"),
    ("ticks.parquet", {"z": ["high"] * 50}, "ticks.parquet: z: holds string"),
]


@pytest.mark.parametrize(("file", "values", "reason"), BROKEN)
def test_broken_run_is_refused_in_one_line(laboratory, file, values, reason):
    change(laboratory, file, **values)
    with pytest.raises(ConfigurationError) as caught:
        read_run(laboratory)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_newer_parquet_is_refused(laboratory):
    table = pa.table(columns()).replace_schema_metadata({"schema": "2"})
    pq.write_table(table, laboratory / "ticks.parquet")
    with refusal(r"ticks.parquet: schema: is 2"):
        read_run(laboratory)


@pytest.mark.parametrize(
    ("missing", "says"),
    [(("profile.parquet",), "profile.parquet: is missing"),
     (("result.yaml", "ticks.parquet"), ": ticks.parquet: is missing, and"),
     (("result.yaml", "profile.parquet"), ": profile.parquet: is missing, and")],
)  # fmt: skip
def test_table_that_is_missing_is_the_one_that_is_named(laboratory, missing, says):
    for name in missing:
        (laboratory / name).unlink()
    with refusal(says):
        read_run(laboratory)


def test_image_changed_behind_the_record_is_refused(finished, tmp_path):
    folder = shutil.copytree(finished, tmp_path / finished.name)
    kept = sorted((folder / "frames").glob("*.png"))
    kept[1].write_bytes(kept[0].read_bytes())
    with refusal("not the image that was recorded"):
        list(read_run(folder).frames())
