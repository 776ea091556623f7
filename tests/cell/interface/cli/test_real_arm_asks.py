"""A real robot moves only once somebody has typed the cell's name, whatever the
command.
"""

import io
from pathlib import Path

import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

import cell
from cell.base.config.places import find_configs
from cell.base.devices.devices import Trial
from cell.base.devices.open import check_drivers, open_cell
from cell.folding.batch import Callbacks, fold_all
from cell.folding.request import standard_requests
from cell.folding.result import FoldResult
from cell.orchestrator.outcome import Outcome
from cell.setup.arm.run_settings import await_strip
from drivers.base.errors import PreflightRefused
from tests.support.commands import run
from tests.support.made_results import DONE, fold_by
from tests.support.refusals import refusal
from tests.support.requests import DENIM, request_for

NOWHERE = "192.0.2.7"  # of the block for documentation: no robot is there
COMMANDS = (
    "home",
    "park",
    "jog --z 5mm",
    "open",
    "calibrate homography",
    "calibrate check",
    "gap plan --strip denim",
    "fold --strip denim",
    "fold --strip denim --rehearse",
)


@pytest.fixture
def configs(configs: Path) -> Path:
    """A cell whose robot stands on another machine."""
    file = configs / "cell.yaml"
    text = file.read_text().replace("arm: twin", "arm: fci")
    file.write_text(f"{text}\nfci: {{address: {NOWHERE}}}\n")
    return configs


@pytest.fixture
def connections(monkeypatch) -> list[str]:
    """What was started to drive a robot: it should be nothing."""
    begun: list[str] = []
    for place in ("drivers.franka.arm.Child", "drivers.franka.joint_requests.go_to"):
        monkeypatch.setattr(place, lambda *_, place=place, **__: begun.append(place))
    return begun


@pytest.mark.parametrize("words", COMMANDS)
@pytest.mark.parametrize(
    ("robot", "typed"), [(NOWHERE, "yes"), ("127.0.3.9, ask: true", "Twin-Cell")]
)
def test_nothing_moves_without_the_cell_s_name(
    robot, typed, words, configs, connections, monkeypatch, capsys, tmp_path
) -> None:
    file = configs / "cell.yaml"
    file.write_text(file.read_text().replace(NOWHERE, robot))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{typed}\n"))
    monkeypatch.setattr("cell.setup.doctor.doctor.checks", lambda *_: iter(()))
    monkeypatch.setattr("cell.setup.doctor.doctor._robot_checks", lambda *_: iter(()))
    assert run(monkeypatch, words, "--configs", configs) == 3
    said = capsys.readouterr().err
    assert "Type the cell's name" in said
    assert "nothing has moved" in said
    assert connections == []


@pytest.mark.parametrize(
    "words", [words for words in COMMANDS if not words.startswith("gap")]
)
def test_doctor_looks_at_a_real_robot_before_anybody_is_asked(
    words, configs, connections, monkeypatch, capsys, tmp_path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO("twin-cell\n"))
    assert run(monkeypatch, words, "--configs", configs) == 3
    said = capsys.readouterr().err
    assert f"robot: no robot answers at {NOWHERE}; switch the robot on" in said
    assert "Type the cell's name" not in said
    assert connections == []


@pytest.mark.parametrize("command", ["home", "park"])
def test_recovery_is_possible_whatever_the_doctor_finds(
    command, configs, connections, monkeypatch, capsys
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("twin-cell\n"))
    run(monkeypatch, command, "--recover --configs", configs)
    assert "Type the cell's name" in capsys.readouterr().err
    assert connections == ["drivers.franka.joint_requests.go_to"]


@pytest.mark.parametrize(
    ("arm", "address", "said"),
    [
        ("twin", None, "moved: the gripper is at x 600, z 160 mm, pitch 0 deg\n"),
        (
            "fci",
            None,
            "pitch 0 deg (emulated robot: fci.address in cell.yaml is empty)\n",
        ),
        (
            "fci",
            "127.0.0.5",
            "pitch 0 deg (emulated robot at 127.0.0.5, on this machine)\n",
        ),
    ],
)
def test_motion_of_an_emulated_robot_says_so(
    arm, address, said, configs, monkeypatch, capsys
) -> None:
    file = configs / "cell.yaml"
    text = file.read_text().replace(f"fci: {{address: {NOWHERE}}}", "")
    file.write_text(text + (f"fci: {{address: {address}}}\n" if address else ""))
    place = "the gripper is at x 600, z 160 mm, pitch 0 deg"
    came = Outcome("moved", place, 0, None, None, 1.0)
    monkeypatch.setattr("cell.setup.arm.manual_motion.move_manually", lambda *_: came)
    assert run(monkeypatch, "jog --z 10mm --arm", arm, "--configs", configs) == 0
    assert capsys.readouterr().out.endswith(said)


def test_way_home_and_fold_of_an_emulated_robot_say_so(
    configs, monkeypatch, capsys
) -> None:
    file = configs / "cell.yaml"
    file.write_text(file.read_text().replace(NOWHERE, "127.0.0.5"))
    monkeypatch.setattr("drivers.franka.joint_requests.go_to", lambda *_, **__: None)
    run(monkeypatch, "park --configs", configs)
    remark = "emulated robot at 127.0.0.5, on this machine"
    assert capsys.readouterr().out == f"the arm is parked ({remark})\n"
    made = FoldResult("runs/one", "denim", "adaptive", 0, "layer_touch", "", 0, 0.001)
    fold_by(monkeypatch, lambda *_: made, agreed=lambda requests, _: requests)
    for words, out in (((), True), (("--json",), False)):
        run(monkeypatch, "fold --strip denim", *words, "--configs", configs)
        said = capsys.readouterr()
        assert (f"  {remark}\n  page" in said.out) == out
        assert (f"cell: {remark}" in said.err) != out


def test_a_program_that_folds_does_not_move_it_either(
    configs, connections, tmp_path
) -> None:
    with pytest.raises(PreflightRefused, match="cell fold"):
        cell.fold("denim", "triangular", configs=configs, runs=tmp_path / "runs")
    assert connections == []


def test_cell_opens_where_it_was_agreed_or_nothing_real_moves(configs) -> None:
    settings = find_configs(configs).cell()
    with pytest.raises(PreflightRefused, match=NOWHERE):
        open_cell(settings, DENIM, Trial(), calibrating=False)
    twin = settings.with_drivers("twin")
    for cell_file, trial in ((settings, Trial(agreed=True)), (twin, Trial())):
        open_cell(cell_file, DENIM, trial, calibrating=False).camera.close()


def test_robot_s_own_time_is_not_taken_in_lock_step(configs) -> None:
    settings = find_configs(configs).cell()
    driven = settings.fci.model_copy(update={"lock_step": True})
    with refusal(r"lock_step.*cannot run in lock-step"):
        check_drivers(settings.model_copy(update={"fci": driven}))


def test_next_run_waits_until_somebody_laid_the_strip(
    configs, monkeypatch, tmp_path
) -> None:
    with pytest.raises(PreflightRefused, match="Enter"):
        await_strip(lambda _: "")
    await_strip(lambda _: "\n")
    laid: list[int] = []
    fold_by(monkeypatch, lambda *_: DONE)
    trial = Trial(agreed=True)
    wanted = standard_requests(request_for("denim", "", tmp_path, configs, trial=trial))
    callbacks = Callbacks(lay_again=lambda: laid.append(1))
    made = list(fold_all(wanted, 4, callbacks=callbacks))
    assert len(laid) == len(made) - 1 > 0
