"""Bad input to `cell gap fit`: one clear line, exit code 2, no verdict, and no
simulation.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cell.gap.subject.mechanism.subject import MechanismSubject
from cell.gap.subject.strip.simulation import Simulation
from cell.gap.subject.strip.synthetic import BENCH
from cell.gap.subject.subject import Origin
from drivers.base.types import Array
from tests.support.commands import refused
from tests.support.gap_strip_cases import STRIP, folds, written
from tests.support.run_edits import edit_column, edit_table, edit_yaml, put
from tests.support.swings import swings_of

Words = list[object]


@dataclass(frozen=True)
class Bench:
    """Good input, to be spoilt: two runs of each subject and their files."""

    root: Path

    def file(self, of: str) -> Path:
        return self.root / f"{of}.yaml"

    def runs(self, of: str) -> Path:
        return self.root / of / "runs"

    def first(self, of: str) -> Path:
        return min(self.runs(of).iterdir())

    def words(self, of: str, *more: object, file: Path | None = None) -> Words:
        """Words of a fit of its runs, and of `more` runs and options."""
        out = ("--strip", file or self.file(of), "--out", self.root / "out")
        return ["gap fit", self.runs(of), *more, *out]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("good")
    written(root / "strip" / "runs", folds(["fast", "taut-lift"]))
    shutil.copy(STRIP, root / "strip.yaml")
    swings_of(root, (0.2, 0.9), 0)
    (root / "pendulum").mkdir()
    (root / "runs").rename(root / "pendulum" / "runs")
    return root


@pytest.fixture
def bench(good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A copy to spoil, where any simulation is a failure."""

    def forbidden(*_: object) -> None:
        pytest.fail("bad input was simulated")

    monkeypatch.setattr(Simulation, "_simulate_together", forbidden)
    monkeypatch.setattr(MechanismSubject, "simulate", forbidden)
    return Bench(Path(shutil.copytree(good, tmp_path / "bench")))


Spoil = Callable[[Path], None]
"""Spoils the first run of a subject."""


def column(file: str, name: str, change: Callable[[Array], Array]) -> Spoil:
    return lambda run: edit_column(run / file, name, change)


def head(**changes: object) -> Spoil:
    return lambda run: edit_yaml(run / "run.yaml", **changes)


def cut(file: str) -> Spoil:
    def spoil(run: Path) -> None:
        content = (run / file).read_bytes()
        (run / file).write_bytes(content[: len(content) // 2])

    return spoil


def thousandfold(values: Array) -> Array:
    return 1e3 * values


def shuffled(values: Array) -> Array:
    return np.random.default_rng(0).permutation(values)


def with_column(name: str, made: Callable[[dict[str, Array]], Array]) -> Spoil:
    """A pendulum's table with another column, made from the others."""
    return lambda run: edit_table(
        run / ANGLES, lambda rows: rows.update({name: made(rows)})
    )


def strip_sigma(**changes: float) -> Spoil:
    return head(sigma=BENCH.model_dump(exclude_none=True) | changes)


TICKS, CURVES, ANGLES = "ticks.parquet", "profile.parquet", "angles.parquet"
SPOILT: dict[tuple[str, str], tuple[Spoil, tuple[str, ...]]] = {
    ("strip", "rows in ms"): (column(TICKS, "t", thousandfold), (TICKS, "t:", "in s")),
    ("strip", "noise in mm"): (
        strip_sigma(contact_x=1.5),
        ("run.yaml: sigma.contact_x", "in m"),
    ),
    ("strip", "negative sigma"): (
        strip_sigma(profile=-1e-3),
        ("run.yaml: sigma.profile", "more than 0"),
    ),
    ("strip", "another strip"): (
        head(strip="cotton"),
        ("run.yaml", "'cotton'", "'denim'", "one strip"),
    ),
    ("strip", "truncated"): (cut(TICKS), (TICKS, "Parquet")),
    ("strip", "index twice"): (
        lambda run: (edit_yaml(run / "run.yaml", index=1), again(run))[1],
        ("run.yaml: index: is 1", "its own"),
    ),
    ("strip", "displacement in mm"): (
        lambda run: edit_yaml(run / "result.yaml", displacement=-30.0),
        ("result.yaml: displacement", "l1 - l2"),
    ),
    ("strip", "noise not stated"): (
        head(sigma=BENCH.model_dump(exclude_none=True, exclude={"gripper"})),
        ("run.yaml: sigma.gripper: is missing",),
    ),
    ("strip", "noise of a picometre"): (
        strip_sigma(contact_x=1e-12),
        ("run.yaml: sigma.contact_x", "at least"),
    ),
    ("strip", "a point at 1e300 m"): (
        column(CURVES, "x", put(5, 1e300)),
        (
            CURVES,
            "x",
        ),
    ),
    ("strip", "a speed of 1e300 m/s"): (head(speed=1e300), ("run.yaml: speed",)),
    ("strip", "an index of 1e20"): (head(index=10**20), ("run.yaml: index",)),
    ("strip", "an outcome of nowhere"): (
        lambda run: edit_yaml(run / "result.yaml", outcome="banana"),
        ("result.yaml: outcome",),
    ),
    ("strip", "a contact half a metre up"): (
        head(contact_height=0.5),
        ("run.yaml: contact_height",),
    ),
    ("strip", "a commanded path out of order"): (
        column(TICKS, "x_cmd", shuffled),
        (TICKS, "x_cmd, z_cmd"),
    ),
    ("pendulum", "angles in degrees"): (
        column(ANGLES, "theta_1", np.degrees),
        (ANGLES, "theta", "in rad"),
    ),
    ("pendulum", "noise in mrad"): (
        head(sigma={"angle": 1.0}),
        ("run.yaml: sigma.angle", "less than 0.3"),
    ),
    ("pendulum", "no sigma"): (head(sigma={}), ("run.yaml: sigma.angle: is missing",)),
    ("pendulum", "another pendulum"): (
        head(pendulum="other"),
        ("run.yaml", "other", "made", "one pendulum"),
    ),
    ("pendulum", "times in microseconds"): (
        column(ANGLES, "t", lambda t: 1e-6 * t),
        (ANGLES, "t is in s"),
    ),
    ("pendulum", "times in milliseconds"): (
        column(ANGLES, "t", thousandfold),
        (ANGLES, "s apart", "t is in s"),
    ),
    ("pendulum", "rates in mrad/s"): (
        with_column(
            "omega_1", lambda rows: 1e3 * np.gradient(rows["theta_1"], rows["t"])
        ),
        (ANGLES, "rates in rad/s"),
    ),
    ("pendulum", "a link too many"): (
        with_column("theta_2", lambda rows: rows["theta_1"]),
        (ANGLES, "1 links only"),
    ),
    ("pendulum", "a few rows"): (
        lambda run: pq.write_table(
            pq.read_table(run / ANGLES).slice(0, 5), run / ANGLES
        ),
        (ANGLES, "at least 30"),
    ),
}


def again(run: Path) -> None:
    """A third run, so that not all indices are equal, and no copy."""
    parent = run.parent
    shutil.copytree(run, parent / "09")
    for table, name in ((CURVES, "z"), (ANGLES, "theta_1")):
        if (run / table).is_file():
            edit_column(parent / "09" / table, name, lambda values: values + 1e-4)
    edit_yaml(parent / "09" / "run.yaml", index=5)


def told(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    bench: Bench,
    words: Words,
) -> str:
    """The one line that refuses `words`; no folder of results is made."""
    line = refused(monkeypatch, capsys, *words)
    assert "\n" not in line
    assert not list(bench.root.rglob("verdict.json"))
    assert not (bench.root / "out").is_dir()
    return line


@pytest.mark.parametrize("case", SPOILT, ids=" ".join)
def test_a_spoilt_run_is_refused_by_name(monkeypatch, capsys, bench, case) -> None:
    subject, _ = case
    spoil, said = SPOILT[case]
    run = bench.first(subject)
    spoil(run)
    line = told(monkeypatch, capsys, bench, bench.words(subject))
    assert run.name in line
    assert all(word in line for word in said), line


@pytest.mark.parametrize("subject", ["strip", "pendulum"])
def test_a_single_run_is_refused(monkeypatch, capsys, bench, subject) -> None:
    words = bench.words(subject)
    words[1] = bench.first(subject)
    line = told(monkeypatch, capsys, bench, words)
    assert f"{words[1]}: one run cannot be both fitted and held out" in line
    words[0] = "gap check"  # nor does it say that it can be fitted
    assert refused(monkeypatch, capsys, *words) == line


def test_the_grippers_path_alone_is_refused_with_what_would_show_the_strip(
    monkeypatch, capsys, bench
) -> None:
    for run in bench.runs("strip").iterdir():
        table = pq.read_table(run / TICKS)
        pq.write_table(table.drop_columns(["contact_x", "contact_t"]), run / TICKS)
        pq.write_table(pq.read_table(run / CURVES).slice(0, 0), run / CURVES)
        (run / "result.yaml").write_text("schema: 1\noutcome: path_done\n")
    line = told(monkeypatch, capsys, bench, bench.words("strip"))
    assert "the gripper's path alone says nothing of the strip" in line
    assert "until the layers touch (the motion `normal`)" in line
    assert "add profile, contact or force" in line


@pytest.mark.parametrize("subject", ["strip", "pendulum"])
def test_runs_of_one_name_are_refused(monkeypatch, capsys, bench, subject) -> None:
    other = shutil.copytree(
        bench.runs(subject), bench.root / "other" / subject / "runs"
    )
    line = told(monkeypatch, capsys, bench, bench.words(subject, other))
    assert "rename one" in line
    assert bench.first(subject).name in line


@pytest.mark.parametrize("subject", ["strip", "pendulum"])
@pytest.mark.parametrize("every", [True, False])
def test_held_out_runs_are_known_and_leave_some(
    monkeypatch, capsys, bench, subject, every
) -> None:
    names = [run.name for run in bench.runs(subject).iterdir()] if every else ["zz"]
    options = (f"--hold-out {name}" for name in names)
    line = told(monkeypatch, capsys, bench, bench.words(subject, *options))
    said = ("held out", "leave some") if every else ("zz", bench.first(subject).name)
    assert all(word in line for word in said), line


@pytest.mark.parametrize(
    ("runs", "file"), [("strip", "pendulum"), ("pendulum", "strip")]
)
def test_the_file_of_the_other_subject_is_refused(
    monkeypatch, capsys, bench, runs, file
) -> None:
    words = bench.words(runs, file=bench.file(file))
    line = told(monkeypatch, capsys, bench, words)
    assert str(bench.first(runs) / "run.yaml") in line
    kind = "strip" if runs == "strip" else "mechanism"
    assert f"its {kind} file" in line


def test_no_file_is_refused_and_one_with_spaces_quoted(
    monkeypatch, capsys, bench
) -> None:
    for file in (bench.root, bench.root / "nope.yaml"):
        line = refused(monkeypatch, capsys, *bench.words("strip", file=file))
        assert line.startswith(f"{file}: is neither a strip")
    file = bench.root / "my strip.yaml"
    file.write_text("kind: strip")
    assert Origin.before_reading(file, "--strip").option == f"--strip '{file}'"


def test_missing_runs_are_refused_and_leave_an_earlier_fit_as_it_is(
    monkeypatch, capsys, tmp_path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in ("verdict.json", "report.html", "fit.json", "overlay.rrd"):
        (out / name).write_text("earlier")
    words = ("gap fit", tmp_path / "none", "--strip denim --out", out)
    line = refused(monkeypatch, capsys, *words)
    assert str(tmp_path / "none") in line
    assert {path.read_text() for path in out.iterdir()} == {"earlier"}
