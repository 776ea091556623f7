"""Copies of measured runs in which effects are hidden: what could these runs have
shown?
"""

from pathlib import Path

import numpy as np
import pytest

from cell.gap import rehearse
from cell.gap.rehearse import Plan, is_right, rehearsal_plan, write_copy
from drivers.strip.effects import registry
from tests.support.gap_strip_cases import FEELING, STRIP, folds, read, written


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("measured")
    written(root / "runs", folds(["normal", "fast"]), FEELING)
    return root / "runs"


@pytest.fixture(scope="module")
def made(runs: Path) -> Plan:
    few = {name: registry()[name] for name in ("desk_tilt", "grip_slip")}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rehearse, "registry", lambda: few)
        return rehearsal_plan([runs], STRIP, 1)


@pytest.mark.slow
def test_every_effect_is_hidden_in_its_size_or_said_to_be_beyond_these_runs(
    made: Plan,
) -> None:
    copies = {copy.effect: copy for copy in made.copies}
    assert [copy.effect for copy in made.copies].count("nothing") == 5
    assert copies.keys().isdisjoint(made.unseen)
    assert {*copies, *made.unseen} == {"desk_tilt", "grip_slip", "nothing"}
    assert 1e-4 < abs(copies["desk_tilt"].values["angle"]) < 0.1
    assert made.base["bending_length"] == pytest.approx(0.017, rel=0.02)


def test_a_copy_follows_the_measured_paths_with_their_noise(
    made: Plan, runs: Path, tmp_path: Path
) -> None:
    still = made.model_copy(update={"scatter": {}})
    write_copy(still, made.copies[-1], tmp_path / "copy")
    pairs = zip(read(runs), read(tmp_path / "copy"), strict=True)
    for real, copy in pairs:
        assert (copy.condition, copy.index) == (real.condition, real.index)
        assert copy.sigma == real.sigma
        t = np.linspace(0.1, 0.9 * real.end, 50)
        paths = [np.interp(t, m.t, m.poses[:, 0]) for m in (real, copy)]
        assert np.abs(paths[0] - paths[1]).max() < 1e-4
        assert copy.touch.time == pytest.approx(real.touch.time, abs=0.15)


EITHER = [["crease", "seam"]]


@pytest.mark.parametrize(
    ("hidden", "named", "classes", "right"),
    [
        ("seam", ["seam"], [], True),
        ("seam", ["crease"], [], False),
        ("seam", ["seam", "crease"], [], False),
        ("seam", [], EITHER, True),
        ("seam", ["ageing"], EITHER, False),
        ("control_delay", ["camera_latency"], [], True),
        ("nothing", [], [], True),
        ("nothing", ["seam"], [], False),
    ],
)
def test_a_copy_is_right_by_its_name_or_by_a_class_that_holds_it(
    hidden: str, named: list[str], classes: list[list[str]], right: bool
) -> None:
    said = {"hidden": hidden, "named": named, "classes": classes}
    assert is_right(said | {"verdict": "named" if named else "no_gap"}) == right
