"""A real robot moves only once somebody has typed the cell's name, whatever the command."""

import io
import shutil
from pathlib import Path

import pytest

pytest.importorskip("pylibfranka", reason="the robot's library is not installed")

import cell
from cell.arm.real_robot import await_strip
from cell.config.places import CHECKOUT_CONFIGS, find_configs
from cell.devices.devices import DeviceSelection
from cell.devices.open import check_drivers, open_cell
from cell.folding.fold import Request
from cell.folding.standard_runs import fold_runs, standard_requests
from drivers.errors import ConfigurationError, PreflightRefused
from drivers.strip.describe import load_strip
from tests.cell.cli.test_command_errors import run

NOWHERE = "192.0.2.7"  # of the block for documentation: no robot is there
COMMANDS = (
    ("home",),
    ("park",),
    ("jog", "--z", "5mm"),
    ("open",),
    ("calibrate", "homography"),
    ("calibrate", "check"),
    ("gap", "plan", "--strip", "denim"),
    ("fold", "--strip", "denim"),
    ("fold", "--strip", "denim", "--rehearse"),
)


@pytest.fixture
def configs(tmp_path: Path) -> Path:
    """A cell whose robot stands on another machine."""
    shutil.copytree(CHECKOUT_CONFIGS, tmp_path / "configs")
    file = tmp_path / "configs" / "cell.yaml"
    text = file.read_text().replace("arm: twin", "arm: fci")
    file.write_text(f"{text}\nfci: {{address: {NOWHERE}}}\n")
    return tmp_path / "configs"


@pytest.fixture
def connections(monkeypatch) -> list[str]:
    """What was started to drive a robot: it should be nothing."""
    begun: list[str] = []
    for place in ("cell.devices.fci.Bridge", "drivers.arm.errands.go_to"):
        monkeypatch.setattr(place, lambda *_, place=place, **__: begun.append(place))
    return begun


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_nothing_moves_without_the_cell_s_name(
    words, configs, connections, monkeypatch, capsys, tmp_path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO("yes\n"))
    monkeypatch.setattr("cell.doctor.doctor.checks", lambda *_: iter(()))
    assert run(monkeypatch, *words, "--configs", configs) == 3
    said = capsys.readouterr().err
    assert "Type the cell's name" in said
    assert "nothing has moved" in said
    assert connections == []


def test_a_program_that_folds_does_not_move_it_either(configs, connections, tmp_path) -> None:
    with pytest.raises(PreflightRefused, match="cell fold"):
        cell.fold("denim", "triangular", configs=configs, runs=tmp_path / "runs")
    assert connections == []


def test_cell_opens_where_it_was_agreed_or_nothing_real_moves(configs) -> None:
    settings, strip = find_configs(configs).cell(), load_strip(configs / "strips" / "denim.yaml")
    with pytest.raises(PreflightRefused, match=NOWHERE):
        open_cell(settings, strip, DeviceSelection(), calibrating=False)
    for choice in (DeviceSelection(agreed=True), DeviceSelection(arm="twin")):
        open_cell(settings, strip, choice, calibrating=False).camera.close()


def test_robot_s_own_time_is_not_taken_in_lock_step(configs) -> None:
    settings = find_configs(configs).cell()
    driven = settings.fci.model_copy(update={"lock_step": True})
    with pytest.raises(ConfigurationError, match=r"lock_step.*waits for nobody"):
        check_drivers(settings.model_copy(update={"fci": driven}), DeviceSelection())


def test_next_run_waits_until_somebody_laid_the_strip(configs, monkeypatch, tmp_path) -> None:
    with pytest.raises(PreflightRefused, match="Enter"):
        await_strip(lambda _: "")
    await_strip(lambda _: "\n")
    laid: list[int] = []
    monkeypatch.setattr("cell.folding.standard_runs.fold", lambda *_, **__: "folded")
    choice = DeviceSelection(agreed=True)
    wanted = standard_requests(
        Request("denim", "", None, choice, tmp_path, configs, None, True, "off")
    )
    made = list(fold_runs(wanted, 4, lay_again=lambda: laid.append(1)))
    assert len(laid) == len(made) - 1 > 0
