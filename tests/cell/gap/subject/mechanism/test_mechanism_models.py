"""Models of others are read as MuJoCo reads them, from their folder alone."""

import os
from collections.abc import Callable
from operator import attrgetter
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cell.gap.open_subject import open_mechanism
from cell.gap.subject.mechanism.model_source import (
    ModelSource,
    compile_model,
    read_source,
)
from cell.gap.subject.run_folders import find_runs
from tests.support.refusals import refusal
from tests.support.shared import CASES, needs

MESHED = """<mujoco><compiler meshdir="assets" autolimits="true"/><include file="parts/joints.xml"/>
<asset><mesh name="a" file="visual/link.obj"/><mesh name="b" file="collision/link.obj"/></asset>
<worldbody><body name="1"><joint name="j" class="arm"/><geom type="mesh" mesh="a"/>
<body name="2" pos="1 0 0"><joint name="k" class="arm"/><geom type="mesh" mesh="b"/></body></body>
</worldbody></mujoco>"""
JOINTS = """<mujocoinclude><include file="parts/option.xml"/>
<default><default class="arm"><joint axis="0 1 0" damping="0.3"/></default></default>
</mujocoinclude>"""
URDF = """<robot name="r"><gazebo><plugin/></gazebo><link name="base"/>
<link name="arm"><collision><geometry>
<mesh filename="{}meshes/collision/link.obj"/></geometry></collision></link>
<joint name="j" type="continuous"><limit drake:effort="3"/>
<parent link="base"/><child link="arm"/></joint></robot>"""


OPTION, LINK = "parts/option.xml", "assets/visual/link.obj"


def tetrahedron(size: float) -> str:
    corners = f"v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nv 0 0 {size}\n"
    return f"{corners}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A robot's folder as it is shipped, with meshes of one name, and what must not be
    opened.
    """
    folder = tmp_path / "robot"
    files = {
        "model.xml": MESHED,
        "parts/joints.xml": JOINTS,
        OPTION: '<mujoco><option gravity="0 0 -3"/></mujoco>',
        LINK: tetrahedron(1.0),
        "assets/collision/link.obj": tetrahedron(2.0),
        "meshes/collision/link.obj": tetrahedron(3.0),
    }
    for name, text in files.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    os.mkfifo(folder / "film.mp4")  # whoever opened it would wait for ever
    return folder


def loaded(path: Path) -> mujoco.MjModel:
    return compile_model(read_source(path, path.parent), str(path), 0, 0.002)


def test_meshes_and_includes_are_those_that_mujoco_finds(robot: Path) -> None:
    path = robot / "model.xml"
    ours, theirs = loaded(path), mujoco.MjModel.from_xml_path(str(path))
    for field in map(attrgetter, ("body_mass", "body_ipos", "body_inertia")):
        np.testing.assert_array_equal(field(ours), field(theirs))
    assert (ours.dof_damping == 0.3).all()
    assert ours.opt.gravity[2] == -3.0
    # of another mesh with the same name
    assert ours.body_mass[2] > 7.0 * ours.body_mass[1]


@pytest.mark.parametrize(
    "package", ["package://robot/", "package://meshes_of_robot/", "../"]
)
def test_packages_of_a_urdf_are_the_folder_and_paths_count_from_its_own(
    robot: Path, package: str
) -> None:
    place = robot / "parts/arm.urdf"
    place.write_text(URDF.format(package))
    model = compile_model(read_source(place, robot), str(place), 0, 0.002)
    assert model.body_mass[1] == pytest.approx(1000.0 * 27.0 / 6.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda folder: (folder / OPTION).write_text(
                '<mujoco><include file="model.xml"/></mujoco>'
            ),
            "includes model.xml twice",
        ),
        (
            lambda folder: (folder / "linked").rename(folder / OPTION),
            "outside",
        ),
        (lambda folder: os.truncate(folder / LINK, 1 << 32), "MB"),
    ],
    ids=["circle", "link", "size"],
)
def test_files_that_are_not_read_are_refused(
    robot: Path, change: Callable[[Path], object], words: str
) -> None:
    (robot / "linked").symlink_to("/etc/hostname")
    change(robot)
    with refusal(words):
        loaded(robot / "model.xml")


def test_changed_texts_find_the_same_meshes(robot: Path) -> None:
    path = robot / "model.xml"
    text = read_source(path, robot).spec().to_xml()
    again = compile_model(ModelSource(text, robot, robot), "again", 0, 0.002)
    np.testing.assert_allclose(again.body_mass, loaded(path).body_mass)


@pytest.mark.slow
@needs(CASES)
@pytest.mark.parametrize(
    "case",
    [
        "closed-loop/model",
        "wrong-link-mass/model",
        "gear-side/model",
        "menagerie-meshdir",
        "urdf-no-motors",
    ],
)
def test_robots_of_others_give_the_same_digits_from_any_folder(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = CASES / case / "robot.yaml"
    (runs,) = (CASES / case.removesuffix("/model")).glob("runs")
    found = []
    for place in (tmp_path, file.parent, Path("/")):
        monkeypatch.chdir(place)
        subject = open_mechanism(Path(os.path.relpath(file)), find_runs([runs]))
        asked = [subject.stated(run) for run in subject.runs]
        found.append(
            np.concatenate([r.mean for r in subject.simulate(asked)]).tobytes()
        )
    assert found[0] == found[1] == found[2]
    said = {finding.what for finding in subject.contradictions()}
    assert ("gear" in said) == (case == "gear-side/model")
