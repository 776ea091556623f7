"""The pendulum as a subject: its physics, its files, hidden effects, and swings really measured."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from scipy.integrate import solve_ivp

from cell.gap.fit import fit, open_subject
from cell.gap.folders import find_runs
from cell.gap.model import Model, Point, evidence, requests
from cell.gap.pendulum.chain import stated, swings
from cell.gap.pendulum.dynamics import swing
from cell.gap.pendulum.file import PendulumFile
from cell.gap.pendulum.library import candidates
from cell.gap.pendulum.runs import make_run
from cell.gap.pendulum.subject import Pendulum
from drivers.errors import ConfigurationError
from drivers.types import Array

DATA = Path(__file__).parents[2] / "shared" / "data" / "pendulum"
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured pendulums in {DATA}")

LINKS = (
    {"mass": 0.2, "length": 0.2, "com": 0.12, "inertia": 5e-4, "damping": 3e-4},
    {"mass": 0.15, "length": 0.18, "com": 0.1, "inertia": 3e-4, "damping": 1e-4},
    {"mass": 0.1, "length": None, "com": 0.1, "inertia": 2e-4, "damping": 5e-5},
)
SIGMA = 0.001
Torque = Callable[[float, float], float]


def content(n: int, **changes: Any) -> dict[str, Any]:
    links = [dict(link) for link in LINKS[:n]]
    links[-1]["length"] = None
    return {
        "schema": 1, "kind": "pendulum", "name": f"p{n}", "gravity": 9.81, "links": links,
    } | changes  # fmt: skip


def pendulum(n: int, **changes: Any) -> PendulumFile:
    return PendulumFile.model_validate(content(n, **changes))


def released(file: PendulumFile, lift: float = 0.5, **effects: list[float]) -> Array:
    n = len(file.links)
    values = {name: np.array(v) for name, v in effects.items()}
    angles = np.pi + lift * np.array([1.0, 1.3, -0.7][:n])[:, None]
    chain = swings(file, stated(file)[None], [values])
    return swing(chain, angles, np.zeros((n, 1)), 0.002, 500)[:, :, :, 0]


# --- physics ---------------------------------------------------------------------------------


def test_chain_moves_as_an_independent_engine_says() -> None:
    file = pendulum(3)
    bodies, close = "", ""
    for i, link in enumerate(file.links):
        above = file.links[i - 1].length if i else 0.0
        inertia = link.inertia
        bodies += (
            f"<body pos='0 0 {-(above or 0.0)}'><joint type='hinge' axis='0 -1 0' "
            f"damping='{link.damping}'/><inertial mass='{link.mass}' pos='0 0 {-link.com}' "
            f"diaginertia='{inertia} {inertia} {inertia}'/>"
        )
        close += "</body>"
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><option integrator='RK4' timestep='0.001' gravity='0 0 -9.81'/><worldbody>"
        f"{bodies}{close}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    ours = released(file)
    bend = ours[0, 0] - np.pi
    data.qpos[:] = -np.diff(bend, prepend=0.0)
    mujoco.mj_step(model, data, 1000)
    theirs = np.pi - np.cumsum(data.qpos)
    np.testing.assert_allclose(ours[-1, 0], theirs, atol=1e-4)


def test_energy_is_kept_without_losses() -> None:
    free = content(2)
    for link in free["links"]:
        link["damping"] = 0.0
    file = PendulumFile.model_validate(free)
    states = released(file, 1.5)
    chain = swings(file, stated(file)[None], [{}])
    lever, moment = chain.lever[:, :, 0], chain.moment[:, 0]

    def energy(theta: Array, omega: Array) -> float:
        inertia = lever * np.cos(theta[:, None] - theta[None])
        return float(0.5 * omega @ inertia @ omega + 9.81 * moment @ np.cos(theta))

    first, last = energy(*states[0]), energy(*states[-1])
    assert abs(last - first) < 1e-6 * 9.81 * moment.sum()


@pytest.mark.parametrize("candidate", candidates(pendulum(2)), ids=lambda c: c.name)
def test_effect_at_null_changes_no_bit_and_otherwise_does(candidate: Any) -> None:
    file = pendulum(2)
    t = np.arange(0.0, 1.0, 0.01)
    run = make_run(file, "r", "r", t, np.full((2, 100), np.pi + 0.4), SIGMA)
    subject, runs = Pendulum(file, [run]), evidence([run])
    plain = Model(subject.library.base)
    start = Point(np.array([p.start for p in plain.parameters]), runs.start())
    without = subject.simulate(requests(plain, [run], start))[0].mean
    model = Model(subject.library.base, (candidate,))
    for values, same in ((candidate.null, True), (np.array(candidate.probes[0][0]), False)):
        point = Point(np.concatenate([start.shared, values]), start.local)
        shown = subject.simulate(requests(model, [run], point))[0].mean
        assert np.array_equal(shown, without) == same


# --- hidden effects, made by another integrator -----------------------------------------------


def made(torque: Torque, seed: int, count: int = 8, damping: float = 2.5e-4) -> list[Array]:
    """Swings of the single pendulum under an extra torque of angle and rate, by scipy."""
    rng = np.random.default_rng(seed)
    link = LINKS[0]
    inertia = link["inertia"] + link["mass"] * link["com"] ** 2
    weight = link["mass"] * link["com"] * 9.81
    t = np.arange(0.0, 4.0, 0.01)

    def slope(_: float, y: Array) -> list[float]:
        bend, rate = y[0] - np.pi, y[1]
        pull = weight * np.sin(y[0]) - damping * rate - torque(bend, rate)
        return [rate, pull / inertia]

    runs = []
    for k in range(count):
        lift = (0.2, 0.5, 0.9, 1.3)[k % 4] * (1.0 + 0.02 * rng.standard_normal())
        y = solve_ivp(slope, (0.0, 4.0), [np.pi + lift, 0.0], "LSODA", t, rtol=1e-8, atol=1e-9).y
        runs.append(np.stack([t, y[0] + SIGMA * rng.standard_normal(len(t))]))
    return runs


def written(folder: Path, runs: list[Array], file: dict[str, Any]) -> tuple[Path, Path]:
    """Run folders and the pendulum file on disk."""
    path = folder / "pendulum.yaml"
    path.write_text(yaml.safe_dump(file))
    for k, rows in enumerate(runs):
        run = folder / "runs" / f"{k:02d}"
        run.mkdir(parents=True)
        head = {
            "schema": 1, "pendulum": file["name"], "index": k, "sigma": {"angle": SIGMA},
            "condition": f"lift {k % 4}",
        }  # fmt: skip
        (run / "run.yaml").write_text(yaml.safe_dump(head))
        columns = {"t": rows[0]} | {f"theta_{i + 1}": r for i, r in enumerate(rows[1:])}
        pq.write_table(pa.table(columns), run / "angles.parquet")
    return path, folder / "runs"


def dry(size: float) -> Torque:
    return lambda _, rate: size * float(np.tanh(rate / 0.005))


def none(_: float, __: float) -> float:
    return 0.0


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """A pendulum with dry friction, fitted: its file, its runs, the fit's folder."""
    folder = tmp_path_factory.mktemp("rubbing")
    file, runs = written(folder, made(dry(4e-4), 1), content(1))
    fit([runs], file, folder / "out")
    return file, runs, folder / "out"


def test_hidden_dry_friction_is_named(rubbing: tuple[Path, Path, Path]) -> None:
    verdict = json.loads((rubbing[2] / "verdict.json").read_text())
    assert verdict["verdict"] == "named"
    (effect,) = verdict["effects"]
    assert effect["name"] == "dry_friction"
    assert effect["parameters"]["torque_1"]["value"] == pytest.approx(4e-4, rel=0.05)
    assert verdict["gap"]["after"]["angle_mrad"] == pytest.approx(1.0, rel=0.1)
    assert verdict["gap"]["shrink"] > 0.8


def test_accepted_effect_leaves_no_gap(rubbing: tuple[Path, Path, Path], tmp_path: Path) -> None:
    file = tmp_path / "accepted.yaml"
    file.write_text((rubbing[2] / "patch.yaml").read_text())
    verdict = fit([rubbing[1]], file, tmp_path / "out")
    assert verdict.verdict == "no_gap"
    assert verdict.base["dry_friction.torque_1"].value == pytest.approx(4e-4, rel=0.05)


def test_same_verdict_whatever_the_number_of_jobs(
    rubbing: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    two = fit([rubbing[1]], rubbing[0], tmp_path / "out", jobs=2)
    one = json.loads((rubbing[2] / "verdict.json").read_text())
    again = json.loads(two.to_json())
    del one["runtime"], again["runtime"]
    assert again == one


def test_swings_with_nothing_hidden_show_no_gap(tmp_path: Path) -> None:
    file, runs = written(tmp_path, made(none, 2), content(1))
    verdict = fit([runs], file, tmp_path / "out")
    assert verdict.verdict == "no_gap"
    assert verdict.effects == []
    assert 0.0 < verdict.detectable["dry_friction"] < 4e-4


def test_drag_of_one_link_cannot_be_told_from_a_quadratic_hinge(tmp_path: Path) -> None:
    file, runs = written(tmp_path, made(lambda _, w: 1e-4 * abs(w) * w, 3), content(1))
    verdict = fit([runs], file, tmp_path / "out")
    assert verdict.verdict == "ambiguous"
    assert verdict.ambiguous == [["air_drag", "quadratic_damping"]]
    assert not (tmp_path / "out" / "patch.yaml").exists()


def test_magnet_under_the_pendulum_is_not_named(tmp_path: Path) -> None:
    magnet: Torque = lambda a, _: 4e-3 * float(np.sin(12 * a) * np.exp(-((a / 0.15) ** 2)))  # noqa: E731
    file, runs = written(tmp_path, made(magnet, 4), content(1))
    verdict = fit([runs], file, tmp_path / "out")
    assert verdict.verdict == "unexplained"
    assert verdict.effects == []
    assert verdict.unexplained is not None


# --- files -----------------------------------------------------------------------------------


def broken(run: Path, fault: str) -> None:
    """Spoil the run folder `run`."""
    table = {k: np.array(v) for k, v in pq.read_table(run / "angles.parquet").to_pydict().items()}
    head = yaml.safe_load((run / "run.yaml").read_text())
    changes: dict[str, Callable[[], Any]] = {
        "column": lambda: table.pop("theta_1"),
        "nan": lambda: table["theta_1"].__setitem__(7, np.nan),
        "order": lambda: table["t"].__setitem__(9, table["t"][3]),
        "degrees": lambda: table.update(theta_1=np.rad2deg(table["theta_1"])),
        "microseconds": lambda: table.update(t=table["t"] * 1e-6),
        "rates": lambda: table.update(omega_1=1e3 * np.gradient(table["theta_1"], table["t"])),
        "name": lambda: head.update(pendulum="another"),
        "sigma": lambda: head.update(sigma={"angle": -1.0}),
        "no sigma": lambda: head.pop("sigma"),
        "link": lambda: table.update(theta_2=table["theta_1"]),
        "short": lambda: table.update({k: v[:5] for k, v in table.items()}),
        "index": lambda: head.update(index="first"),
    }
    changes[fault]()
    pq.write_table(pa.table(table), run / "angles.parquet")
    (run / "run.yaml").write_text(yaml.safe_dump(head))


@pytest.mark.parametrize(
    ("fault", "word"),
    [
        ("column", "theta_1: this column is missing"), ("nan", "row 7 is not a number"),
        ("order", "does not increase at row 9"), ("degrees", "angles are in rad"),
        ("microseconds", "t is in s"), ("rates", "rates in rad/s"), ("name", "is another"),
        ("sigma", "sigma.angle"), ("no sigma", "sigma.angle"), ("link", "1 links only"),
        ("short", "at least 30"), ("index", "index"),
    ],
)  # fmt: skip
def test_bad_run_is_one_clear_line_and_no_verdict(tmp_path: Path, fault: str, word: str) -> None:
    rows = [np.stack([np.arange(0, 1, 0.01), np.pi + 0.3 * np.cos(np.arange(0, 10, 0.1))])] * 3
    file, runs = written(tmp_path, rows, content(1))
    broken(runs / "01", fault)
    with pytest.raises(ConfigurationError, match="01/") as caught:
        fit([runs], file, tmp_path / "out")
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out" / "verdict.json").exists()


def test_single_run_is_refused(tmp_path: Path) -> None:
    rows = [np.stack([np.arange(0, 1, 0.01), np.full(100, np.pi)])]
    file, runs = written(tmp_path, rows, content(1))
    with pytest.raises(ConfigurationError, match="single run"):
        fit([runs / "00"], file, tmp_path / "out")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"colour": "red"}, "unknown key"), ({"gravity": -9.81}, "gravity"),
        ({"links": []}, "links"), ({"effects": {"magnet": {"size": 1.0}}}, "unknown effect"),
        ({"effects": {"air_drag": {"coefficient": -1.0}}}, "out of range"),
        ({"schema": 2}, "this version reads 1"), ({"kind": "kite"}, "kind"),
    ],
)  # fmt: skip
def test_bad_pendulum_file_is_refused(tmp_path: Path, change: dict[str, Any], word: str) -> None:
    rows = [np.stack([np.arange(0, 1, 0.01), np.full(100, np.pi + 0.1)])] * 3
    file, runs = written(tmp_path, rows, content(1) | change)
    with pytest.raises(ConfigurationError, match=word):
        fit([runs], file, tmp_path / "out")


# --- measured pendulums ------------------------------------------------------------------------

FALSE = ("frame_tilt", "encoder_bias", "wire_spring", "pivot_compliance", "quadratic_damping")


def check_triple(verdict: Any) -> None:
    assert verdict.verdict == "named"
    assert sorted(e.name for e in verdict.effects) == ["air_drag", "dry_friction"]
    assert 1.5 < verdict.gap.before["angle_mrad"] < 3.0
    assert verdict.gap.after["angle_mrad"] <= 0.9
    assert verdict.gap.shrink_low > 0.4
    (drag,) = (c for c in verdict.candidates if c.name == "air_drag")
    for single in (c for c in verdict.candidates if c.name in FALSE):
        assert single.elpd_gain < 0.2 * drag.elpd_gain


@real
def test_triple_pendulum_has_air_drag_and_dry_friction(tmp_path: Path) -> None:
    runs = [DATA / "triple" / "runs" / f"{k:02d}" for k in (0, 3, 6, 9, 12, 15, 18, 21, 24)]
    check_triple(fit(runs, DATA / "triple" / "pendulum.yaml", tmp_path / "out"))


@real
@pytest.mark.slow
def test_whole_triple_pendulum_has_air_drag_and_dry_friction(tmp_path: Path) -> None:
    triple = DATA / "triple"
    check_triple(fit([triple / "runs"], triple / "pendulum.yaml", tmp_path / "out"))


@real
def test_single_pendulum_is_fitted_by_coulomb_and_quadratic_losses_and_names_no_other(
    tmp_path: Path,
) -> None:
    single = DATA / "single"
    verdict = fit([single / "runs"], single / "pendulum.yaml", tmp_path / "out")
    assert not {e.name for e in verdict.effects} & {"frame_tilt", "wire_spring", "pivot_compliance"}
    pairs = {c.name: c.p for c in verdict.candidates if " + " in c.name}
    best = min(pairs, key=lambda name: pairs[name])
    assert best in ("air_drag + dry_friction", "dry_friction + quadratic_damping")


@real
def test_measured_swings_are_read_whole() -> None:
    subject = open_subject(
        DATA / "triple" / "pendulum.yaml", find_runs([DATA / "triple" / "runs"]), 1
    )
    assert len(subject.runs) == 26
    assert [run.index for run in subject.runs] == list(range(26))
