"""Hidden causes in made swings: named, refused, accepted, undone."""

import json
import re
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from cell.gap.fit import FitOptions, fit
from cell.gap.subject.mechanism.mechanism_file import MechanismFile
from cell.gap.verdict.accept import accept
from cell.gap.verdict.schema import Verdict, read_verdict
from drivers.base.readers import read_yaml
from drivers.base.settings import load
from drivers.base.types import Array
from tests.support import swings
from tests.support.refusals import refusal
from tests.support.swings import Law, swings_of

PASSING = {"runtime": 0.0, "next": None}  # that fits of the same runs differ in
LIFTS = (0.2, 0.5, 0.9, 1.3)


def drag(_: Array, rate: Array, __: int) -> Array:
    return 1e-4 * np.abs(rate) * rate


def fitted(folder: Path, law: Law | None, seed: int) -> Verdict:
    """Verdict on swings made under a hidden law."""
    file, runs = swings_of(folder, 2 * LIFTS, seed, law)
    return fit([runs], file, folder / "out")


def lasting(verdict: Verdict) -> str:
    """What stays the same where the same runs are fitted again."""
    return verdict.model_copy(update=PASSING).to_json()


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a pendulum that rubs, its runs and its fit."""
    folder = tmp_path_factory.mktemp("rubbing")
    fitted(folder, swings.rubbing, 1)
    return folder


def test_hidden_dry_friction_is_named(rubbing: Path) -> None:
    verdict = read_verdict(rubbing / "out" / "verdict.json")
    assert verdict.verdict == "named"
    (effect,) = verdict.effects
    assert effect.name == "dry_friction"
    assert effect.parameters["torque_1"].value == pytest.approx(4e-4, rel=0.05)
    assert verdict.gap.after["angle_mrad"] == pytest.approx(1.0, rel=0.1)
    assert verdict.gap.shrink > 0.8


KEYS = [*read_yaml(Path(__file__).with_name("verdict_keys.yaml")).values()]
"""Of a verdict, an effect, a value, the gap, a place and a candidate, in their order."""


def test_verdict_file_is_the_contract_and_holds_only_numbers(rubbing: Path) -> None:
    text = (rubbing / "out" / "verdict.json").read_text()
    verdict = json.loads(
        text, parse_constant=lambda word: pytest.fail(f"{word} in verdict.json")
    )
    effect, gap = verdict["effects"][0], verdict["gap"]
    assert (verdict["schema"], effect["of"]) == (1, "strip")
    value = effect["parameters"]["torque_1"]
    parts = (verdict, effect, value, gap, verdict["where"][0], verdict["candidates"][0])
    assert [*map(list, parts)] == KEYS
    assert list(verdict["base"]["damping_1"]) == list(value)[:-1]
    assert list(gap["before"]) == ["angle_mrad", "excess"]


@pytest.mark.slow
def test_an_interrupted_fit_is_made_again_alike_whatever_the_number_of_jobs(
    rubbing: Path, tmp_path: Path
) -> None:
    def interrupting(stage: str, share: float) -> None:
        if stage == "judge":
            raise KeyboardInterrupt

    runs, file, out = [rubbing / "runs"], rubbing / "pendulum.yaml", tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        fit(runs, file, out, progress=interrupting)
    assert not out.exists()
    whole = read_verdict(rubbing / "out" / "verdict.json")
    assert lasting(whole) == lasting(fit(runs, file, out, FitOptions(jobs=2)))


def test_report_is_one_page_that_needs_nothing_else(rubbing: Path) -> None:
    page = (rubbing / "out" / "report.html").read_text()
    assert "Joints rub like dry friction" in page
    assert page.count("<svg") >= 3
    known = (
        "www.w3.org",
        "purl.org",
        "creativecommons.org",
        "matplotlib.org",
        "d3js.org",
    )
    addresses = re.findall(r"https?://([a-z0-9.]+)", page)
    # names in figures, never fetched
    assert all(address in known for address in addresses)
    assert not re.findall(r"<(?:link|iframe|[a-z]+ [^<>]*\bsrc=)[^<>]*>", page)


def test_accepted_effect_leaves_no_gap(rubbing: Path, tmp_path: Path) -> None:
    copytree(rubbing, tmp_path, dirs_exist_ok=True)
    file, out = tmp_path / "pendulum.yaml", tmp_path / "out"
    accepted = accept(out, file)
    assert accepted.effects == ("dry_friction",)
    pendulum = load(file, MechanismFile)
    assert pendulum.effects["dry_friction"]["torque_1"] == pytest.approx(4e-4, rel=0.05)
    notes = {note.key: note.note for note in pendulum.provenance}
    assert notes["damping_1"].startswith("was 0.00025, is ")
    again = fit([rubbing / "runs"], file, tmp_path / "again")
    assert again.verdict == "no_gap"
    assert again.base["dry_friction.torque_1"].value == pytest.approx(4e-4, rel=0.05)
    assert [name for name in again.base if "." in name] == ["dry_friction.torque_1"]


def test_swings_with_nothing_hidden_show_no_gap(tmp_path: Path) -> None:
    verdict = fitted(tmp_path, None, 2)
    assert verdict.verdict == "no_gap"
    assert verdict.effects == []
    assert 0.0 < verdict.detectable["dry_friction"] < 4e-4
    assert not (tmp_path / "out" / "patch.yaml").exists()
    with refusal("nothing was named"):
        accept(tmp_path / "out", tmp_path / "pendulum.yaml")


@pytest.mark.slow
def test_drag_of_one_link_cannot_be_told_from_a_quadratic_hinge(tmp_path: Path) -> None:
    verdict = fitted(tmp_path, drag, 3)
    assert verdict.verdict == "ambiguous"
    assert verdict.ambiguous == [["air_drag", "quadratic_damping"]]
    assert verdict.effects == []
