"""A wizard that was interrupted goes on where it was, and what was taken back stays
out.
"""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from calibration.calibration import save_calibration
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.progress import Progress, SessionRow
from calibration.wizard.session import read_rows
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import TouchSettings
from cell.base.config.places import CHECKOUT_CONFIGS, Configs
from cell.base.devices.devices import Devices, Trial
from cell.base.devices.open import NO_STRIP, open_cell
from cell.orchestrator.operator import Answer, Interrupted, Question, Unattended
from cell.setup.calibration_in_use import use_calibration
from cell.setup.wizard import Wizard
from drivers.base.errors import ConfigurationError
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.cell.conftest import straight_camera
from tests.support.board_sessions import LENS
from tests.support.twin_calibration import NO_STRIP as NO_LOOK, pointer_frame

pytestmark = pytest.mark.slow

SETTINGS = Configs(CHECKOUT_CONFIGS).cell()


def _devices() -> Devices:
    return open_cell(SETTINGS, NO_STRIP, Trial(), calibrating=True)


class Hesitant:
    """Takes the fourth view back, and stops once six are wanted no more."""

    def __init__(self) -> None:
        self.answers = 0

    def answer(self, _: Question) -> Answer:
        self.answers += 1
        return Answer.AGAIN if self.answers == 5 else Answer.GO

    def stops(self) -> bool:
        return self.answers > 7


@pytest.fixture(scope="module")
def gone_on(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[LensVerdict, Path, int, list[Progress]]:
    """A session that was interrupted, its folder, its images until then, the progress
    since.
    """
    folder, person = tmp_path_factory.mktemp("sessions") / "lens", Hesitant()
    with pytest.raises(Interrupted):
        Wizard(SETTINGS, _devices(), person, interrupted=person.stops).calibrate_lens(
            folder, None
        )
    with (folder / "told.jsonl").open("a") as file:
        file.write('{"number": 99, "ima')  # the process died while it wrote
    before = len([*(folder / "images").iterdir()])
    progress: list[Progress] = []
    wizard = Wizard(SETTINGS, _devices(), Unattended(), progress.append)
    return wizard.calibrate_lens(folder, None), folder, before, progress


def test_interrupted_session_goes_on_with_the_views_it_has(gone_on) -> None:
    verdict, folder, before, progress = gone_on
    assert verdict.passed, verdict.reasons
    assert before == 6
    views = next(gate for gate in progress[0].coverage if gate.name == "views")
    assert views.have == before - 1  # one was taken back
    assert len([*(folder / "images").iterdir()]) == verdict.views + 1
    assert all(row.number != 99 for row in read_rows(folder))


def test_session_of_another_camera_does_not_go_on(gone_on) -> None:
    other = replace(_devices(), camera_identity="other camera")
    with pytest.raises(
        ConfigurationError,
        match=r"--resume: .*camera: is .*, here it is other camera; set it back",
    ):
        Wizard(SETTINGS, other, Unattended()).calibrate_lens(gone_on[1], None)


def test_touches_go_on_with_the_points_that_are_missing() -> None:
    points, renderer = (
        TouchedPoints(LENS, TouchSettings()),
        Renderer(CameraSettings(), NO_LOOK, 0),
    )
    rows = [(k, points.plan[k]) for k in (0, 1, 4)]
    for k, p in rows:
        row = SessionRow(number=k, pose=(p.x, p.z, p.pitch))
        assert points.restore(row, pointer_frame(renderer, p, k).image)
    assert [point.number for point in points.touches] == [0, 1, 4]
    asked = []
    while points.number is not None:
        asked.append(points.number)
        points.skip()
    assert asked == [2, 3, *range(5, 24)]


def test_calibration_is_put_to_use_without_a_change_of_anything_else(
    tmp_path: Path,
) -> None:
    path, cell_file = tmp_path / "calibration.yaml", tmp_path / "cell.yaml"
    save_calibration(straight_camera(), path)
    before = (CHECKOUT_CONFIGS / "cell.yaml").read_text()
    cell_file.write_text(before)
    use_calibration(cell_file, path)
    after = cell_file.read_text()
    line = re.search(r"^calibration:\s+\S+\n", after, re.MULTILINE)[0]
    assert after.replace(line, "") == before
    assert Configs(tmp_path).cell().calibration == str(path)
