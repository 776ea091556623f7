"""`cell strips`: what its commands print, write and refuse."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.strip.describe import load_strip
from tests.support.commands import refused, run
from tests.support.hanging_photographs import Scene, photograph


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("photos") / "hanging.png"
    cv2.imwrite(str(path), photograph(Scene(0.06, 0.021, 0.002, 700), 3))
    return path


def test_a_strip_file_that_cannot_be_read_does_not_hide_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], configs: Path
) -> None:
    (configs / "strips" / "broken.yaml").write_text("name: [")
    assert run(monkeypatch, "strips --configs", configs) == 0
    told = capsys.readouterr()
    assert "denim" in told.out
    assert told.err.startswith(f"cell: {configs / 'strips' / 'broken.yaml'}")


def test_measure_prints_pictures_and_leaves_strip_files_alone(
    monkeypatch, capsys, configs, tmp_path, photo
) -> None:
    before = (configs / "strips" / "denim.yaml").read_bytes()
    out = tmp_path / "out"
    words = ("--photo", photo, "--overhang 0.06 --out", out, "--configs", configs)
    assert run(monkeypatch, "strips measure denim", *words) == 0
    told = capsys.readouterr().out
    assert told.startswith("denim: bending length 2")
    assert "95 %" in told
    assert str(out) in told
    assert (configs / "strips" / "denim.yaml").read_bytes() == before
    picture = cv2.imread(str(out / "01-hanging.png"))
    assert picture.shape[0] > 800
    assert json.loads((out / "measurement.json").read_text())["strip"] == "denim"


def test_measure_writes_the_bending_length_and_where_it_comes_from(
    monkeypatch, capsys, configs, tmp_path, photo
) -> None:
    path = configs / "strips" / "denim.yaml"
    path.write_text(
        path.read_text().replace("width: 0.05", "width: 0.05  # cut with a knife")
    )
    before = load_strip(path)
    words = f"--photo {photo} --overhang 0.06 --out {tmp_path}/out --write --json"
    assert run(monkeypatch, "strips measure denim", words, "--configs", configs) == 0
    line = json.loads(capsys.readouterr().out)
    after = load_strip(path)
    assert line["written"] == str(path)
    assert after.bending_length == pytest.approx(
        line["bending_length"]["value"], rel=1e-3
    )
    assert after.bending_length == pytest.approx(0.021, rel=0.05)
    assert (
        "cantilever test, 1 photograph at overhangs of 0.06 m"
        in after.provenance[0].source
    )
    old = next(each for each in after.provenance[1:] if each.key == "bending_length")
    assert old.note.startswith(f"until then {before.bending_length:g}")
    assert len(after.provenance) == len(before.provenance) + 1
    assert "# cut with a knife" in path.read_text()
    changed = {"bending_length", "provenance"}
    assert after.model_dump(exclude=changed) == before.model_dump(exclude=changed)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "--photo: is missing"),
        ("--photo {photo}", "0 given for 1"),
        ("--photo {photo} --photo {photo} --overhang 0.1", "1 given for 2"),
        ("--photo {photo} --overhang 6", "if 6 is in mm, write 6mm"),
        ("--photo {photo} --overhang -0.1", "at least 0.01 m"),
        ("--photo {photo} --overhang nan", "--overhang: 'nan' is no length"),
        ("--photo gone.jpg --overhang 0.1", "gone.jpg: cannot be read"),
        ("--photo {text} --overhang 0.1", "not a picture"),
        ("--photo {empty} --overhang 0.1", "not a picture"),
        ("--photo {dark} --overhang 0.1", "no bright object"),
        ("--photo {edge} --overhang 0.1", "no bright object is wider than two pixels"),
        ("--photo {blob} --overhang 0.1", "no strip"),
        ("--photo {level} --overhang 0.1", "out of range"),
        ("--photo {rising} --overhang 0.1", "does not hang like a strip"),
    ],
)
def test_bad_input_is_one_clear_line_and_nothing_is_written(
    monkeypatch, capsys, tmp_path, photo, words, said
) -> None:
    paths = {"photo": photo, **bad_pictures(tmp_path)}
    out = tmp_path / "out"
    words = f"strips measure sample --out {out} {words.format(**paths)}"
    assert said in refused(monkeypatch, capsys, words)
    assert not out.exists()


def bad_pictures(folder: Path) -> dict[str, Path]:
    """Files that hold no picture of a hanging strip."""
    drawn = {
        "dark": None,
        "blob": ([(0, 300), (60, 300)], 200),
        "edge": ([(599, 0), (599, 799)], 1),
        "level": ([(0, 400), (500, 400)], 20),
        "rising": ([(0, 600), (200, 580), (400, 400), (450, 100)], 20),
    }
    paths = {name: folder / f"{name}.png" for name in drawn}
    for name, stroke in drawn.items():
        image = np.full((800, 600, 3), 20, np.uint8)
        if stroke is not None:
            points = np.array(stroke[0], np.int32)
            cv2.polylines(
                image, [points], False, (220, 220, 220), stroke[1], cv2.LINE_AA
            )
        cv2.imwrite(str(paths[name]), image)
    paths |= {name: folder / f"{name}.jpg" for name in ("text", "empty")}
    paths["text"].write_text("a photograph")
    paths["empty"].write_bytes(b"")
    return paths


def test_writing_to_an_unknown_strip_is_refused_before_anything_is_measured(
    monkeypatch, capsys, configs, tmp_path, photo
) -> None:
    words = ("--photo", photo, "--overhang 0.06 --out", tmp_path / "out", "--write")
    line = refused(
        monkeypatch, capsys, "strips measure silk", *words, "--configs", configs
    )
    assert "cell strips new" in line
    assert not (tmp_path / "out").exists()


def test_new_strip_says_what_was_assumed(monkeypatch, capsys, configs) -> None:
    sizes = "--length 0.5 --width 0.04 --areal-density 0.31 --colour 10 20 30"
    told = "--source 'areal_density=scales, 2026'"
    code = run(monkeypatch, "strips new felt", sizes, told, "--configs", configs)
    assert code == 0
    assert (
        "assumed, not measured: bending_length, retardation_time"
        in capsys.readouterr().out
    )
    strip = load_strip(configs / "strips" / "felt.yaml")
    assert (strip.name, strip.length, strip.width, strip.areal_density) == (
        "felt",
        0.5,
        0.04,
        0.31,
    )
    sources = {each.key: each.source for each in strip.provenance}
    assert (sources["areal_density"], sources["bending_length"]) == (
        "scales, 2026",
        "assumed",
    )


@pytest.mark.parametrize(
    ("name", "words", "said"),
    [
        ("denim", "", "is there already"),
        ("../felt", "", "not a name"),
        ("unknown", "", "not a name"),
        ("felt", "--length 50", "length"),
        ("felt", "--source colour=eye", "KEY=TEXT"),
        ("felt", "--source thickness=gauge", "value too"),
    ],
)
def test_new_strip_that_cannot_be_is_refused(
    monkeypatch, capsys, configs, name, words, said
) -> None:
    def strips() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in (configs / "strips").iterdir()}

    before = strips()
    new = "strips new --length 0.5 --width 0.04"
    words = (new, name, words, "--configs", configs)
    assert said in refused(monkeypatch, capsys, *words)
    assert strips() == before
