"""Whole folds through images: what is measured agrees with the truth, also on a rig
that is off.
"""

import shutil
import struct
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from calibration.calibration import (
    change_calibration,
    load_calibration,
    save_calibration,
)
from cell.base.config.places import find_configs
from cell.base.devices.devices import Trial
from cell.folding.batch import fold_all
from cell.folding.replay import replay
from cell.folding.request import RecordingOptions
from cell.perception.length_checks import SURPRISING, disagreements, doubts
from cell.record.files import CALIBRATION, EVENTS, RECORDING, REPORT, TRUTH
from cell.report.overlay import SHOWN_OUTLINES, ShownImages, silhouettes
from cell.report.page import report, write_report
from cell.report.viz.recording import viz_from_run
from drivers.base.errors import ConfigurationError
from drivers.base.readers import read_yaml
from policies.feedback import COMMITTED, load_checkpoint, save_checkpoint
from tests.end_to_end.folded import Folded, fold_and_keep
from tests.support.requests import request_for
from tests.support.seen_folds import distances

pytestmark = pytest.mark.slow


def test_the_triangle_ends_short_of_the_fixed_edge(denim: Folded) -> None:
    assert denim.result.outcome == "layer_touch"
    assert denim.result.exit_code == 0
    assert -0.060 < denim.result.displacement < -0.020


def test_displacement_and_touch_are_seen_as_they_were(denim: Folded) -> None:
    truth = denim.truth.touch
    assert denim.result.displacement == pytest.approx(truth.displacement, abs=0.003)
    assert denim.result.layer_touch == pytest.approx(
        truth.time - denim.origin, abs=0.05
    )


def across(denim: Folded, curve: np.ndarray) -> list[np.ndarray]:
    """A `curve` (n, 2) of the strip as it appears at depths from its near edge to its
    far one.
    """
    view = denim.run.calibration().viewpoint
    shares = np.linspace(0.0, view.sweep(denim.run.header.strip_file["width"]), 8)
    return [curve + share * (view.foot() - curve) for share in shares]


def test_page_shows_the_strip_where_it_was_laid(denim: Folded) -> None:
    run = denim.run
    seen = silhouettes(run, ShownImages.of(run))
    assert len(seen) == SHOWN_OUTLINES
    assert {outline.state for outline in seen} == {"LAY", "RELEASE"}
    stamps = {note.sequence: note.stamp for note in run.frame_index()}
    for outline in seen:
        true = denim.true_shape(stamps[outline.sequence])
        off = np.min(
            [distances(outline.plane, curve) for curve in across(denim, true)], axis=0
        )
        assert np.percentile(off, 95) < 0.002
        clear = true[true[:, 0] > 0.1][:-5]  # the hand covers the ends
        assert distances(clear, outline.plane).max() < 0.006
    text = report(run)
    assert "LAY" in text
    assert "outline of the strip once the layers touch" in text


def test_measured_time_begins_flat_still_and_held(denim: Folded) -> None:
    ticks = denim.run.ticks
    assert ticks.t[0] == 0.0
    assert abs(ticks.x[0] - 0.6) < 2e-4
    assert abs(ticks.z[0]) < 2e-4
    assert abs(ticks.pitch[0]) < 2e-3
    assert np.diff(ticks.t).max() < 0.0101


def test_replay_decides_the_same_from_the_stored_images(denim: Folded) -> None:
    again = replay(Path(denim.result.run))
    assert again.differences == ()
    assert again.images > 200
    assert again.decisions > 200


def most_images(_folder: str, names: list[str]) -> list[str]:
    """All but the first and every twentieth."""
    images = sorted(name for name in names if name.endswith(".png"))
    return [name for i, name in enumerate(images) if i % 20]


def test_replay_notices_another_calibration(denim: Folded, tmp_path: Path) -> None:
    copy = shutil.copytree(denim.result.run, tmp_path / "run", ignore=most_images)
    path = copy / "run.yaml"
    header = yaml.safe_load(path.read_text())
    # as in runs of other versions
    header["config"]["perception"] = {"contact_height": 0.002}
    path.write_text(yaml.safe_dump(header))
    path = copy / CALIBRATION
    save_calibration(
        change_calibration(load_calibration(path), contact_bias=0.001), path
    )
    assert replay(copy).differences


def test_replay_without_images_decides_again_on_what_was_seen(
    denim: Folded, tmp_path: Path
) -> None:
    pictures = shutil.ignore_patterns("*.png")
    copy = shutil.copytree(denim.result.run, tmp_path / "run", ignore=pictures)
    again = replay(copy)
    assert (again.images, again.differences) == (0, ())
    assert again.decisions > 200
    events = copy / EVENTS
    events.write_text(events.read_text().replace('"done": false', '"done": true', 1))
    assert len(replay(copy).differences) == 1
    events.write_text(events.read_text().replace('"direction"', '"dire', 1))
    assert replay(copy).decisions == again.decisions - 1
    events.write_text(events.read_text().replace('"direction"', '"turn"', 1))
    with pytest.raises(ConfigurationError, match=r"events\.jsonl: the decision at"):
        replay(copy)


@pytest.fixture(scope="module")
def secret(tmp_path_factory: pytest.TempPathFactory) -> Folded:
    """Another strip lies there than the controller believes, and the weights are not
    our own.
    """
    place = tmp_path_factory.mktemp("secret")
    changes = {"name": "zebrafish", "bending_length": 0.0213}
    plant = find_configs(None).strip("denim").model_copy(update=changes)
    weights = load_checkpoint(COMMITTED)
    scaled = tuple(0.95 * weight for weight in weights.weights)
    save_checkpoint(place / "own.json", weights.model_copy(update={"weights": scaled}))
    kept = RecordingOptions(truth=False)
    asked = {"record": kept, "trial": Trial(plant=plant)}
    asked |= {"checkpoint": place / "own.json"}
    request = request_for("denim", "feedback", place / "r", **asked)
    folded = fold_and_keep(request)
    folder = Path(folded.result.run)
    write_report(folder)
    viz_from_run(folder)
    return folded


def test_the_folder_of_a_fold_is_small(secret: Folded) -> None:
    drawn = {REPORT, RECORDING}  # once it is looked at
    files = [path for path in Path(secret.result.run).rglob("*") if path.is_file()]
    kept = [path.stat().st_size for path in files if path.name not in drawn]
    assert sum(kept) < 5e6


def test_a_run_holds_nothing_of_the_plant_but_its_hash(secret: Folded) -> None:
    folded, folder = secret, Path(secret.result.run)
    assert (folder / RECORDING).exists()
    assert not (folder / TRUTH).exists()
    assert len(folded.run.header.plant_sha256) == 64
    for path in folder.rglob("*"):
        if path.is_file():
            held = path.read_bytes()
            assert b"zebrafish" not in held, path
            assert b"0.0213" not in held, path
            for number in ("<d", ">d", "<f", ">f"):
                assert struct.pack(number, 0.0213) not in held, path
    stiffer = folded.truth.touch.displacement
    assert folded.result.displacement == pytest.approx(stiffer, abs=0.003)


def test_replay_decides_with_the_weights_of_the_run(
    secret: Folded, tmp_path: Path
) -> None:
    folder = Path(secret.result.run)
    assert replay(folder).same
    copy = shutil.copytree(folder, tmp_path / "run")
    header = yaml.safe_load((copy / "run.yaml").read_text())
    assert len(header.pop("checkpoint")["sha256"]) == 64
    (copy / "run.yaml").write_text(yaml.safe_dump(header))
    assert replay(copy).differences


def test_same_seed_same_bytes_whatever_the_jobs(denim: Folded, tmp_path: Path) -> None:
    requests = [
        request_for("denim", "triangular", tmp_path / "again"),
        request_for("denim", "triangular", tmp_path / "again", trial=Trial(seed=4)),
    ]
    same, other = fold_all(requests, jobs=2)
    lines = [denim.result.line(), same.line(), other.line()]
    for line in lines:
        line.pop("run")
        line.pop("wall")
    assert lines[1] == lines[0]
    assert lines[2] != lines[0]
    for name in ("ticks.parquet", "profile.parquet"):
        first = (Path(denim.result.run) / name).read_bytes()
        assert (Path(same.run) / name).read_bytes() == first, name
        assert (Path(other.run) / name).read_bytes() != first, name


def test_record_keeps_the_contract(denim: Folded) -> None:
    folder = Path(denim.result.run)
    ticks = pq.read_table(folder / "ticks.parquet")
    assert ticks.schema.metadata[b"schema"] == b"1"
    result = yaml.safe_load((folder / "result.yaml").read_text())
    assert result["displacement"] == pytest.approx(
        result["l1"] - result["l2"], abs=1e-12
    )
    images = [note.sequence for note in denim.run.frame_index()]
    assert images == sorted(set(images))


def test_camera_arm_and_prediction_agree(denim: Folded) -> None:
    known = [each.name for each in denim.result.witnesses]
    assert known == ["free_edge", "grip", "displacement", "edges"]
    assert disagreements(denim.result.witnesses, SURPRISING) == ()


CONFIGS = Path(__file__).parents[2] / "configs"
Effects = Mapping[str, Mapping[str, float]]
RIG: dict[str, dict[str, float]] = read_yaml(Path(__file__).with_name("rig.yaml"))


def affected(effects: Effects, folder: Path, *, accepted: bool) -> Folded:
    """A fold of denim on a rig with `effects`; where the cell file states them, images
    are kept.
    """
    configs, record = (
        folder / "configs",
        RecordingOptions("all" if accepted else "none"),
    )
    shutil.copytree(CONFIGS, configs)
    if accepted:
        written(configs / "cell.yaml", effects)
    request = request_for(
        "denim", "triangular", folder / "runs", configs, record=record
    )
    plant = request.strip.model_copy(update={"effects": dict(effects)})
    return fold_and_keep(replace(request, trial=Trial(seed=3, plant=plant)))


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


def test_rig_that_is_off_in_every_known_way_measures_like_one_that_is_not(
    denim: Folded, tmp_path: Path
) -> None:
    folded = affected(RIG, tmp_path, accepted=True)
    result = folded.result
    assert result.outcome == "layer_touch"
    assert result.displacement == pytest.approx(result.displacement_true, abs=1e-3)
    assert result.displacement_true == pytest.approx(
        denim.result.displacement_true, abs=1.5e-3
    )
    assert (
        np.abs(contact_errors(folded)).mean()
        < np.abs(contact_errors(denim)).mean() + 3e-4
    )
    assert replay(Path(folded.result.run)).same


@pytest.mark.parametrize("name", ["tcp_offset", "homography_shift"])
def test_hidden_effect_shows(name: str, denim: Folded, tmp_path: Path) -> None:
    folded = affected({name: RIG[name]}, tmp_path, accepted=False)
    if name == "homography_shift":
        assert "camera's map is" in folded.result.warning
        assert doubts(folded.result.witnesses).keys() >= {"grip", "edges"}
    off = (
        np.abs(contact_errors(folded)).mean()
        > np.abs(contact_errors(denim)).mean() + 1e-3
    )
    missed = abs(folded.result.displacement - folded.result.displacement_true) > 2e-3
    assert off or missed
