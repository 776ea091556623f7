"""The wizards at the twin: unattended, kept, solved again from their folder to the last
bit, gone on with after an interruption.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibration.calibration import load_calibration, save_calibration
from calibration.homography import Homography
from calibration.lens import read_lens
from calibration.wizard.lens_verdict import LensVerdict
from calibration.wizard.progress import Progress, SessionRow
from calibration.wizard.session import read_rows
from calibration.wizard.touch_verdict import MapVerdict
from calibration.wizard.touched_points import TouchedPoints
from calibration.wizard.touches import TouchSettings
from cell.base.config.places import CHECKOUT_CONFIGS, Configs
from cell.base.devices.devices import Devices, Trial
from cell.base.devices.open import NO_STRIP, open_cell
from cell.folding.fold import fold
from cell.folding.request import RecordingOptions
from cell.orchestrator.calibration_phase import POINTER_IN, POINTER_OUT, STEPS_QUESTION
from cell.orchestrator.operator import Answer, Interrupted, Question, Unattended
from cell.setup.calibration_in_use import use_calibration
from cell.setup.wizard import Wizard, newest_lens, solve_homography, solve_lens
from drivers.twin.renderer.renderer import Renderer
from drivers.twin.settings import CameraSettings
from tests.cell.conftest import straight_camera
from tests.support import twin_calibration as twin
from tests.support.board_sessions import LENS
from tests.support.refusals import refusal
from tests.support.requests import CELL, DENIM, request_for
from tests.support.twin_calibration import true_lens

pytestmark = pytest.mark.slow
CAMERA = CELL.twin.camera


def _devices() -> Devices:
    return open_cell(CELL, NO_STRIP, Trial(), calibrating=True)


class Person:
    """Leaves point 3 out, repeats the one before point 6 once, agrees to the rest."""

    def __init__(self) -> None:
        self.asked: list[Question] = []
        self._repeated = False

    def answer(self, question: Question) -> Answer:
        self.asked.append(question)
        if question.words.startswith("point 3 "):
            return Answer.SKIP
        if question.words.startswith("point 6 ") and not self._repeated:
            self._repeated = True
            return Answer.AGAIN
        return Answer.GO


@pytest.fixture(scope="module")
def touched(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[MapVerdict, Path, Person]:
    person = Person()
    folder = tmp_path_factory.mktemp("sessions") / "homography"
    wizard = Wizard(CELL, _devices(), person)
    return wizard.calibrate_homography(true_lens(CAMERA), folder), folder, person


@pytest.fixture(scope="module")
def shown(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[LensVerdict, Path, list[Progress]]:
    told: list[Progress] = []
    folder = tmp_path_factory.mktemp("sessions") / "camera"
    wizard = Wizard(CELL, _devices(), Unattended(), told.append)
    return wizard.calibrate_lens(folder, None), folder, told


def _without(folder: Path, left_out: str, place: Path) -> Path:
    """A session like that in `folder`, in `place`, but for one file."""
    for path in folder.iterdir():
        if path.name != left_out:
            (place / path.name).symlink_to(path)
    return place


def _change(folder: Path, again: Path, **facts: object) -> None:
    """Write the session.yaml of `folder` with other `facts` to the folder `again`."""
    content = yaml.safe_load((folder / "session.yaml").read_text())
    (again / "session.yaml").write_text(yaml.safe_dump(content | facts))


def test_homography_wizard_makes_a_calibration_of_this_camera(touched) -> None:
    verdict, folder, _ = touched
    made = verdict.calibration
    assert made.camera == CAMERA.identity
    assert made.residual_mm < 0.1
    assert made.latency == pytest.approx(0.0, abs=0.001)
    assert made.landmarks is not None
    assert made.accepted_anyway == ()
    assert load_calibration(folder / "calibration.yaml").id == made.id


def test_person_is_asked_before_every_motion_and_obeyed(touched) -> None:
    verdict, folder, person = touched
    assert person.asked[0] == POINTER_IN
    assert person.asked[-2:] == [STEPS_QUESTION, POINTER_OUT]
    assert not any("disagrees" in question.words for question in person.asked)
    assert 3 not in verdict.touches.errors_mm
    assert sum(q.words.startswith("point 5 ") for q in person.asked) == 2
    rows = [
        (row.number, row.image is not None)
        for row in read_rows(folder)
        if row.image is not None or row.dropped
    ]
    assert rows[4:7] == [(5, True), (5, False), (5, True)], (
        "taken, taken back, taken anew"
    )


def test_touches_solved_again_from_their_folder_are_the_same_to_the_last_bit(
    touched,
) -> None:
    verdict, folder, _ = touched
    solved = solve_homography(folder, (), None)
    made = solved.calibration
    assert made.id == verdict.calibration.id
    assert solved.latency == verdict.latency


def test_point_is_left_out_by_its_number_and_what_comes_of_it_is_kept(
    touched, tmp_path
) -> None:
    verdict, folder, _ = touched
    solved = solve_homography(folder, (7,), tmp_path / "again")
    made = solved.calibration
    assert solved.touches.errors_mm.keys() == verdict.touches.errors_mm.keys() - {7}
    assert load_calibration(tmp_path / "again" / "calibration.yaml").id == made.id


def test_too_few_points_are_refused_even_with_the_override(touched) -> None:
    _, folder, _ = touched
    many = tuple(range(6, 24))
    with refusal(r"--without: unknown name '24' .*allowed: 0, 1"):
        solve_homography(folder, (24,), None)
    assert solve_homography(folder, many, None).calibration is None
    with_all = solve_homography(folder, many, None, accept_anyway=True)
    assert with_all.calibration is None
    assert "at least 12 are needed" in with_all.touches.reasons[0]


def test_override_names_the_reasons_in_the_calibration(touched, tmp_path) -> None:
    _, folder, _ = touched
    again = _without(folder, "latency.json", tmp_path)
    assert solve_homography(again, (), None).calibration is None
    made = solve_homography(again, (), None, accept_anyway=True).calibration
    assert made.accepted_anyway == ("the latency was not measured",)


def test_image_of_a_swapped_size_is_refused(touched, tmp_path) -> None:
    _, folder, _ = touched
    again = _without(folder, "session.yaml", tmp_path)
    _change(folder, again, image=[720, 1280])
    with refusal(r"is 1280 x 720 px, .* says image: \[720, 1280\]"):
        solve_homography(again, (), None)


def test_camera_wizard_keeps_a_lens_for_ros_and_for_opencv(shown) -> None:
    verdict, folder, told = shown
    assert verdict.passed, verdict.reasons
    assert all(
        one.sketch.seen is not None for one in told if one.result and one.result.taken
    )
    for name in ("camera_info.yaml", "opencv.yaml"):
        lens = read_lens(folder / name)
        assert np.array_equal(lens.matrix, verdict.fit.lens.matrix)
    assert newest_lens(folder.parent, CAMERA.identity).parent == folder
    with refusal("holds no lens of camera other"):
        newest_lens(folder.parent, "other")


def test_fold_with_a_camera_that_moved_since_is_refused_before_the_strip_is_touched(
    touched, tmp_path
) -> None:
    verdict = touched[0]
    shift = {"homography_shift": {"x": 0.005, "z": 0.0}}
    plant = DENIM.model_copy(update={"effects": shift})
    trial, record = Trial(plant=plant), RecordingOptions("none", truth=False)
    request = request_for(
        "denim",
        "triangular",
        tmp_path / "runs",
        CHECKOUT_CONFIGS,
        trial=trial,
        record=record,
    )
    result = fold(request, verdict.calibration)
    assert (result.outcome, result.exit_code) == ("preflight_refused", 3)
    assert "the gripper appears moved by x +4.9" in result.reason
    header = yaml.safe_load((Path(result.run) / "run.yaml").read_text())
    assert header["calibration"]["id"] == verdict.calibration.id
    assert header["preflight"][0]["name"] == "camera stands where it was calibrated"


@pytest.mark.parametrize(("shift", "holds"), [(0.0, True), (0.0015, False)])
def test_calibration_is_checked_by_touching_five_points(
    touched, shift: float, holds: bool
) -> None:
    made = touched[0].calibration
    moved = np.array([[1, 0, shift], [0, 1, 0], [0, 0, 1]]) @ made.homography.matrix
    old = replace(made, homography=Homography.from_matrix(moved))
    told: list[Progress] = []
    verdict = Wizard(CELL, _devices(), Unattended(), told.append).check(old)
    assert verdict.passed is holds
    assert sorted(verdict.errors_mm) == [0, 1, 2, 3, 4]
    assert verdict.median_mm == pytest.approx(1e3 * shift, abs=0.15)
    assert verdict.lines()[-1].text.startswith("good" if holds else "refused")
    assert told[0].request.startswith("the arm goes to x ")


def test_misprinted_board_is_refused_by_the_ruler(shown, tmp_path) -> None:
    _, folder, _ = shown
    again = _without(folder, "session.yaml", tmp_path)
    _change(folder, again, length=0.98 * CELL.boards.width)
    verdict = solve_lens(again, (), None)
    assert not verdict.passed
    assert (
        "9 squares measure 247.0 mm, configured are 252.0 mm, +2.0 %"
        in verdict.reasons[0]
    )


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
        Wizard(CELL, _devices(), person, interrupted=person.stops).calibrate_lens(
            folder, None
        )
    with (folder / "told.jsonl").open("a") as file:
        file.write('{"number": 99, "ima')  # the process died while it wrote
    before = len([*(folder / "images").iterdir()])
    progress: list[Progress] = []
    wizard = Wizard(CELL, _devices(), Unattended(), progress.append)
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
    with refusal(
        r"--resume: .*camera: is .*, here it is other camera; set it back",
    ):
        Wizard(CELL, other, Unattended()).calibrate_lens(gone_on[1], None)


def test_touches_go_on_with_the_points_that_are_missing() -> None:
    points, renderer = (
        TouchedPoints(LENS, TouchSettings()),
        Renderer(CameraSettings(), twin.NO_STRIP, 0),
    )
    rows = [(k, points.plan[k]) for k in (0, 1, 4)]
    for k, p in rows:
        row = SessionRow(number=k, pose=(p.x, p.z, p.pitch))
        assert points.restore(row, twin.pointer_frame(renderer, p, k).image)
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
