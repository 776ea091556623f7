"""Copies of measured runs in which effects are hidden: what could these runs have
shown?
"""

from pathlib import Path

import numpy as np
import pytest

from cell.gap import rehearse
from cell.gap.rehearse import HiddenCopy, Plan, is_right, rehearsal_plan, write_copy
from cell.gap.subject.run_folders import find_runs
from cell.gap.subject.strip.runs import read_runs
from drivers.strip.describe import load_strip
from drivers.strip.effects import registry
from tests.support.gap_strip_cases import STRIP, folds, written


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("measured")
    written(root / "runs", folds(["normal", "fast"]))
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
    effects = [copy.effect for copy in made.copies]
    assert effects.count("nothing") == 5
    assert not set(effects) & set(made.unseen)
    assert "desk_tilt" in effects
    assert {*effects, *made.unseen} == {"desk_tilt", "grip_slip", "nothing"}
    (tilt,) = (copy for copy in made.copies if copy.effect == "desk_tilt")
    assert 1e-4 < abs(tilt.values["angle"]) < 0.1
    assert made.base["bending_length"] == pytest.approx(0.017, rel=0.02)


def test_a_copy_follows_the_measured_paths_with_their_noise(
    made: Plan, runs: Path, tmp_path: Path
) -> None:
    still = made.model_copy(update={"scatter": {}})
    write_copy(
        still,
        HiddenCopy(key="n", effect="nothing", values={}, seed=3),
        tmp_path / "copy",
    )
    strip = load_strip(STRIP)
    before, after = (
        read_runs(find_runs([p]), strip) for p in (runs, tmp_path / "copy")
    )
    for real, copy in zip(before, after, strict=True):
        assert (copy.condition, copy.index) == (real.condition, real.index)
        assert copy.sigma == real.sigma
        t = np.linspace(0.1, 0.9 * real.end, 50)
        paths = [np.interp(t, m.t, m.poses[:, 0]) for m in (real, copy)]
        assert np.abs(paths[0] - paths[1]).max() < 1e-4
        assert copy.touch.time == pytest.approx(real.touch.time, abs=0.15)


def outcome(
    hidden: str, *named: str, classes: tuple[tuple[str, ...], ...] = ()
) -> dict:
    verdict = "named" if named else "ambiguous" if classes else "no_gap"
    return {
        "hidden": hidden,
        "values": {"size": 1.0},
        "verdict": verdict,
        "named": list(named),
        "classes": [list(c) for c in classes],
        "confidence": 0.8 if named else None,
    }


def test_a_copy_is_right_by_its_name_or_by_a_class_that_holds_it() -> None:
    assert is_right(outcome("seam", "seam"))
    assert not is_right(outcome("seam", "crease"))
    assert not is_right(outcome("seam", "seam", "crease"))
    assert is_right(outcome("seam", classes=(("crease", "seam"),)))
    assert not is_right(outcome("seam", "ageing", classes=(("crease", "seam"),)))
    assert is_right(outcome("control_delay", "camera_latency"))
    assert is_right(outcome("nothing"))
    assert not is_right(outcome("nothing", "seam"))
