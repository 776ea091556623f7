"""Runs exported to the formats of other programs come back as they were, to the last
bit.
"""

import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from cell.record.exchange import lerobot
from cell.record.exchange.export_runs import Format, export_runs
from cell.record.exchange.import_runs import import_runs
from cell.record.files import EVENTS
from cell.record.film import FilmWriter
from cell.record.frames import FrameWriter
from cell.record.run import MOTION, read_run
from drivers.base.errors import ConfigurationError
from drivers.base.types import Frame
from tests.support.foreign_tables import STAMPS, foreign, mapping
from tests.support.refusals import refusal
from tests.support.run_edits import edit_column, put


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    place = tmp_path_factory.mktemp("runs")
    folders = [foreign(place / name) for name in ("a", "b")]
    made = import_runs(folders, mapping(place), place / "runs")
    for folder in made:
        edit_column(folder / "ticks.parquet", "f_x", put(9, np.nan))
        (folder / EVENTS).write_text('{"t": 0.5, "kind": "fault", "name": "late"}\n')
        film = FrameWriter(folder, "key", patient=True, encoder="libx264")
        for i, stamp in enumerate(STAMPS.tolist()):
            film.put(
                Frame(stamp, stamp, "camera", i, np.full((64, 96, 3), 3 * i, np.uint8)),
                False,
            )
        film.close()
    return made


def brought_back(runs: Sequence[Path], kind: Format, place: Path) -> tuple[Path, ...]:
    """The `runs`, exported and imported again."""
    exported = export_runs(runs, kind, place / "out")
    return import_runs(exported, None, place / "back")


@pytest.mark.parametrize("kind", ["csv", "lerobot", "mcap"])
def test_exported_runs_come_back_bit_for_bit(
    runs, kind: Format, tmp_path: Path
) -> None:
    made = brought_back(runs, kind, tmp_path)
    for was, now in zip(map(read_run, runs), map(read_run, made), strict=True):
        assert (now.name, now.header, now.result) == (was.name, was.header, was.result)
        ticks, known = asdict(now.ticks), asdict(was.ticks)
        for name in (*MOTION, "contact_x", "contact_t"):
            np.testing.assert_equal(ticks[name], known[name])
        np.testing.assert_equal(asdict(now.profile), asdict(was.profile))
        if kind == "lerobot":
            stamps = [list(run.film_stamps().values()) for run in (was, now)]
            assert np.allclose(*stamps, atol=0.0101)  # s, between two rows


def test_runs_of_two_strips_are_exported_where_each_states_its_own(
    runs, tmp_path
) -> None:
    folders = [runs[0], shutil.copytree(runs[1], tmp_path / "other")]
    head = folders[1] / "run.yaml"
    head.write_text(head.read_text().replace("denim", "linen"))
    made = brought_back(folders, "lerobot", tmp_path)
    assert [read_run(folder).header.strip for folder in made] == ["denim", "linen"]
    with refusal("in strip, start or sigma"):
        export_runs(folders, "csv", tmp_path / "csv")
    with FilmWriter(folders[1] / "film.mp4") as film:
        for stamp in STAMPS:
            film.add(stamp, np.zeros((32, 48, 3), np.uint8))
    with refusal("images have another size"):
        export_runs(folders, "lerobot", tmp_path / "again")


def test_a_file_whose_writer_was_killed_gives_its_whole_chunks(
    runs, tmp_path: Path
) -> None:
    [made, _] = export_runs(runs, "mcap", tmp_path / "out")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(made.read_bytes()[:-4000])
    [folder] = import_runs([cut], None, tmp_path / "back")
    assert np.array_equal(read_run(folder).ticks.x, read_run(runs[0]).ticks.x)


@pytest.mark.parametrize("kind", ["lerobot", "mcap"])
def test_a_spoilt_export_is_refused_in_one_line(
    runs, kind: Format, tmp_path: Path
) -> None:
    made = export_runs(runs, kind, tmp_path / "out")
    path = made[0] if kind == "mcap" else made[0] / "data/chunk-000/file-000.parquet"
    content = bytearray(path.read_bytes())
    content[200:900] = bytes(700)
    path.write_bytes(bytes(content))
    with pytest.raises(ConfigurationError) as error:
        import_runs(made, None, tmp_path / "back")
    assert "\n" not in str(error.value)
    assert not list((tmp_path / "back").glob("*"))


def test_the_rate_of_a_set_is_the_usual_one_whatever_the_longest_gap() -> None:
    ticks = SimpleNamespace(t=np.array([0.0, 0.01, 0.02, 0.03, 0.5]))
    assert lerobot._rate([cast(Any, SimpleNamespace(ticks=ticks))]) == 100
