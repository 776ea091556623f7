"""However a run ends, the devices are let go and the record says so."""

from pathlib import Path
from types import SimpleNamespace

import pytest

import cell.folding.fold
from cell.base.config.places import CHECKOUT_CONFIGS
from cell.folding.fold import fold, run_and_record
from cell.folding.request import RecordingOptions
from cell.orchestrator.outcome import Outcome
from cell.orchestrator.recorder import FileRecorder
from cell.record.files import is_under_way
from cell.record.run import read_run
from cell.record.writer import RunWriter
from drivers.base.errors import Fault
from drivers.twin.settings import CameraSettings
from tests.cell.conftest import HEADER, straight_camera
from tests.support.dying import no_room
from tests.support.requests import request_for

DONE = Outcome("path_done", "the path ended and no touch was seen", 1, None, None, 9.0)


class Devices:
    """Counts what is taken hold of and let go; `wrong` says what fails."""

    def __init__(self, wrong: str = "") -> None:
        self.clock = SimpleNamespace(now=lambda: 3.5)
        self.arm_timing = dict
        self.real_time = False
        self._wrong = wrong
        self.closed = 0

    def connect(self) -> None:
        if self._wrong == "connect":
            raise Fault("arm_refused", "the brakes are closed")

    def close(self) -> None:
        self.closed += 1
        if self._wrong == "close":
            raise Fault("arm_closed", "it was gone already")


def running(end: Outcome | BaseException) -> SimpleNamespace:
    def execute() -> Outcome:
        if isinstance(end, BaseException):
            raise end
        return end

    return SimpleNamespace(execute=execute)


@pytest.fixture
def recorder(tmp_path: Path) -> FileRecorder:
    recorder = FileRecorder(RunWriter(tmp_path, HEADER, "none"))
    recorder.folder = next(tmp_path.iterdir())
    return recorder


def test_devices_that_refuse_are_an_outcome(recorder: FileRecorder) -> None:
    devices = Devices("connect")
    outcome = run_and_record(running(DONE), devices, recorder)
    assert (outcome.name, outcome.reason) == ("arm_refused", "the brakes are closed")
    assert (outcome.exit_code, outcome.duration) == (4, 3.5)
    assert devices.closed == 1
    assert recorder.origin == 0.0
    assert read_run(recorder.folder).result.outcome == "arm_refused"


def test_the_second_ctrl_c_is_recorded(recorder: FileRecorder) -> None:
    devices = Devices()
    outcome = run_and_record(running(KeyboardInterrupt()), devices, recorder)
    assert (outcome.reason, outcome.exit_code) == (
        "stopped at once by Ctrl-C or a signal",
        130,
    )
    assert devices.closed == 1
    assert read_run(recorder.folder).result.outcome == "interrupted"


def test_a_ctrl_c_while_the_record_ends_leaves_it_whole(recorder, monkeypatch) -> None:
    from cell.record import writer

    write_tables, pressed = writer.tables.write_tables, []

    def impatient(*arguments) -> None:
        if not pressed:
            pressed.append(True)
            raise KeyboardInterrupt
        write_tables(*arguments)

    monkeypatch.setattr(writer.tables, "write_tables", impatient)
    with pytest.raises(KeyboardInterrupt):
        run_and_record(running(DONE), Devices(), recorder)
    assert read_run(recorder.folder).result.outcome == "path_done"


def test_a_disk_that_fills_up_at_the_end_is_the_outcome(recorder, monkeypatch) -> None:
    from cell.record import writer

    monkeypatch.setattr(writer.tables, "write_tables", no_room)
    outcome = run_and_record(running(DONE), Devices(), recorder)
    assert (outcome.name, outcome.exit_code) == ("record", 4)
    assert "No space left" in outcome.reason
    assert read_run(recorder.folder).result is None
    assert not is_under_way(recorder.folder)


def test_what_controls_a_fold_has_no_way_to_the_plant(tmp_path, monkeypatch) -> None:
    seen: list[SimpleNamespace] = []

    def blind(devices: SimpleNamespace, *_: object) -> SimpleNamespace:
        seen.append(devices)
        return SimpleNamespace(execute=lambda: DONE)

    monkeypatch.setattr(cell.folding.fold, "ControlLoop", blind)
    record = RecordingOptions("none")
    request = request_for(
        "denim", "triangular", tmp_path, CHECKOUT_CONFIGS, record=record
    )
    result = fold(request, straight_camera(camera=CameraSettings().identity))
    assert (result.outcome, result.exit_code) == ("path_done", 1)
    assert seen[0].plant is None
    assert seen[0].aids is None
    assert (Path(result.run) / "truth.yaml").exists()
