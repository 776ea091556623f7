"""Recordings of a mechanism are held against its model before anything is named."""

from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from typing import Any

import mujoco
import numpy as np
import pytest

from cell.gap.fit import fit
from cell.gap.subject.run_table import unwrapped
from cell.gap.subject.subject import Finding
from drivers.base.errors import ConfigurationError
from drivers.base.types import Array
from tests.support.mechanisms import (
    ARM,
    FORWARD,
    PRESCRIBED,
    make_arm,
    moved,
    opened,
    write_run,
)
from tests.support.refusals import refusal
from tests.support.run_edits import edit_table

T = np.arange(0.0, 4.0, 0.01)
SWING = 1.7 * np.sin(2.0 * T) + 0.4
FLOOR = (
    '<geom name="floor" type="plane" size="2 2 .1" pos="0 0 -0.45"/><body name="upper">'
)
Columns = dict[str, Array]
Change = Callable[[Columns], object]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Mechanism file and folder of three sound runs, which nobody changes."""
    return make_arm(tmp_path_factory.mktemp("arm"), 3, content=PRESCRIBED)


def found(
    file: Path, runs: Path, out: Path, change: Change, only: str = "*"
) -> list[Finding]:
    """Findings on copies in `out` of the `runs` of `file`, all or one under a
    `change`.
    """
    copytree(runs, out, dirs_exist_ok=True)
    for table in out.glob(f"{only}/signals.parquet"):
        edit_table(table, change)
    return [*opened(file, out).contradictions()]


def lines(*spoilt: Any) -> list[str]:
    """Lines on findings, or the one that refuses the runs."""
    try:
        return [*map(str, found(*spoilt))]
    except ConfigurationError as error:
        return [str(error)]


def scaled(name: str, factor: float) -> Change:
    """Change that multiplies a column by a factor."""
    return lambda table: table.update({name: table[name] * factor})


def late(t1: float, t2: float) -> Change:
    """Change that stamps torques late by so many seconds."""

    def change(table: Columns) -> None:
        for name, delay in (("t1", t1), ("t2", t2)):
            table[name] = np.interp(table["t"] - delay, table["t"], table[name])

    return change


@pytest.mark.parametrize("delays", [(0.0, 0.0), (0.02, -0.008)])
def test_nothing_contradicts_sound_recordings_or_joints_without_one_lag(
    sound, tmp_path: Path, delays: tuple[float, float]
) -> None:
    assert not found(*sound, tmp_path, late(*delays))


@pytest.mark.parametrize(
    ("factor", "said"), [(1.0, None), (1000.0, "in N mm?"), (-1.0, "reversed")]
)
def test_a_command_in_another_unit_or_sign_is_told_where_the_motion_is_simulated(
    tmp_path: Path, factor: float, said: str | None
) -> None:
    motors = ARM.replace('kp="60"/>', 'gear="2"/>').replace('kp="30"/>', "/>")
    motors = motors.replace("<position", "<motor")
    file, runs = make_arm(tmp_path / "made", 3, content=FORWARD, stated=motors)
    # or such commands blow the model up
    told = lines(file, runs, tmp_path / "runs", scaled("a1", factor))
    assert [said in one for one in told] == ([] if said is None else [True])


@pytest.mark.parametrize(
    ("delay", "levels"), [(0.006, ["bad"]), (-0.021, ["fair"]), (0.0, [])]
)
def test_a_lag_of_either_sign_is_told_in_ms_beside_what_the_mechanism_lacks(
    tmp_path: Path, delay: float, levels: list[str]
) -> None:
    def sprung(model: Any) -> None:
        model.jnt_stiffness[:] = 1.5

    arm = make_arm(tmp_path / "made", 3, sprung, PRESCRIBED)
    told = found(*arm, tmp_path, late(delay, delay))
    assert [one.level for one in told if one.what == "lag"] == levels
    for one in told:
        seen = float(one.words.split(" late by ")[1].split()[0])
        assert seen == pytest.approx(1e3 * abs(delay), abs=0.5)


def random_torque(table: Columns) -> None:
    """Change that puts noise for the elbow's torque."""
    table["t2"] = np.random.default_rng(2).normal(0.0, 2.0, len(table["t"]))


@pytest.mark.parametrize(
    ("change", "what", "run", "words"),
    [
        (
            scaled("t2", 1000.0),
            "unit",
            "*",
            "t2: is 1e+03 times the model's torque at the motor: in N mm?",
        ),
        (scaled("t2", -1.0), "sign", "*", "t2 is the model's torque reversed"),
        (scaled("t2", -31.0), "unit", "*", "reversed"),
        (scaled("t1", 2.2), "contradicts the others", "01", "t1"),
        (late(0.012, 0.012), "lag", "01", "late by 1"),
        (random_torque, "torque of no motion", "02", "t2"),
    ],
)
def test_what_contradicts_the_model_is_told_by_joint_and_run(
    sound,
    tmp_path: Path,
    change: Change,
    what: str,
    run: str,
    words: str,
) -> None:
    (one,) = found(*sound, tmp_path, change, run)
    assert (one.what, one.run or "*", one.level) == (what, run, "bad")
    assert words in one.words


def test_a_run_that_does_not_move_is_told(sound, tmp_path: Path) -> None:
    def still(table: Columns) -> None:
        table["shoulder"], table["elbow"] = 1e-4 * table["t"], 0.3 + 0.0 * table["t"]

    told = found(*sound, tmp_path, still, "00")
    assert ("no motion", "00") in [(one.what, one.run) for one in told]


@pytest.mark.parametrize("name", ["elbow", "t1"])
def test_a_reading_that_sticks_is_told_by_its_row(
    sound, tmp_path: Path, name: str
) -> None:
    def stuck(table: Columns) -> None:
        table[name][100:160] = table[name][100]

    words = lines(*sound, tmp_path, stuck, "01")  # or it jumps as it comes free
    assert [line for line in words if "01" in line and "stands still" in line]
    assert "row 100 on" in words[0]


def test_a_motor_at_its_limit_is_no_stuck_reading(sound, tmp_path: Path) -> None:
    def clip(table: Columns) -> None:
        table["t1"][100:160] = table["t1"].max()

    told = found(*sound, tmp_path, clip, "01")
    assert "stuck reading" not in [f.what for f in told]


def test_turns_are_taken_out_and_said(sound, tmp_path: Path) -> None:
    def wrap(table: Columns) -> None:
        table["elbow"] = np.mod(table["elbow"], 2.0 * np.pi)

    told = found(*sound, tmp_path, wrap)
    assert {one.what for one in told} == {"wrapped"}
    assert str(told[0]).startswith("00: wrapped: elbow wraps by a turn at")


def test_every_single_step_is_held_against_those_about_it() -> None:
    mended, rows = unwrapped(T, np.mod(SWING, 2.0 * np.pi), "run: elbow")
    np.testing.assert_allclose(mended, SWING)
    assert rows[0] == int(np.argmax(SWING < 0.0))
    broken = SWING + 1.1 * (T > 2.0)
    with refusal(r"elbow: jumps .* at row 201 "):
        unwrapped(T, broken, "run: elbow")
    assert unwrapped(T, SWING, "run: elbow") == (SWING, [])


@pytest.mark.parametrize(("contype", "share"), [("1", "57 %"), ("0", "")])
def test_what_touches_along_the_motion_is_told(
    tmp_path: Path, contype: str, share: str
) -> None:
    floor = FLOOR.replace(
        "name=", f'contype="{contype}" conaffinity="{contype}" name=', 1
    )
    on_floor = ARM.replace('<body name="upper">', floor)
    file, runs = make_arm(tmp_path, 2, content=PRESCRIBED, stated=on_floor)
    told = [*map(str, opened(file, runs).contradictions())]
    assert len(told) == bool(share)
    assert all("contact" in one and share in one for one in told)


def test_a_fit_refuses_what_contradicts_the_model_and_names_nothing(
    sound, tmp_path: Path
) -> None:
    file, runs = sound
    found(file, runs, tmp_path / "runs", late(0.014, 0.014))
    with refusal(r"lag: torques are late by 14\.\d ms"):
        fit([tmp_path / "runs"], file, tmp_path / "out")
    assert not (tmp_path / "out" / "verdict.json").exists()


@pytest.mark.slow
def test_friction_that_falls_as_grease_warms_is_told_by_the_order_of_runs(
    tmp_path: Path,
) -> None:
    file, runs = make_arm(tmp_path, 6, content=PRESCRIBED)
    model = mujoco.MjModel.from_xml_string(ARM)
    model.opt.timestep = 0.0005
    rng = np.random.default_rng(0)
    for number, rate in enumerate((1.5, 2.5, 1.0, 3.0, 2.0, 0.7)):
        model.dof_frictionloss[:] = 0.4 / (1.0 + number)
        table = moved(model, rate, 3.0)
        for name in ("t1", "t2"):
            table[name] = table[name] + rng.normal(0.0, 0.02, len(table["t"]))
        head = {"mechanism": "arm", "index": number}
        write_run(runs / f"{number:02d}", table, head)
    notes = fit([runs], file, tmp_path / "out").notes
    assert [note for note in notes if "with the order of the runs" in note]
