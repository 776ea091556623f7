"""Hidden causes in made swings: named, refused, accepted, undone."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cell.base.config.places import CHECKOUT_CONFIGS
from cell.gap.fit import FitOptions, fit
from cell.gap.subject.mechanism.mechanism_file import MechanismFile
from cell.gap.verdict.accept import accept, undo
from cell.gap.verdict.fit_folder import MODEL_PATCH
from cell.gap.verdict.schema import Verdict, read_verdict
from drivers.base.errors import ConfigurationError
from drivers.base.settings import load
from tests.support.fit_folders import write_fit
from tests.support.swings import PENDULUM, Law, make_swings, write_swings

SIGMA = 0.001
PASSING = {"runtime": 0.0, "next": None}  # that fits of the same runs differ in
LIFTS = [np.array([a]) for a in (0.2, 0.5, 0.9, 1.3, 0.2, 0.5, 0.9, 1.3)]


def dry(_: Any, rate: Any, __: int) -> Any:
    return 4e-4 * np.tanh(rate / 0.005)


def drag(_: Any, rate: Any, __: int) -> Any:
    return 1e-4 * np.abs(rate) * rate


def fitted(folder: Path, law: Law | None, seed: int) -> tuple[Verdict, Path, Path]:
    """Verdict, file and runs of swings made under a hidden law."""
    made = make_swings(
        PENDULUM / "model.xml", LIFTS, SIGMA, np.random.default_rng(seed), law
    )
    file, runs = write_swings(folder, made, SIGMA)
    return fit([runs], file, folder / "out"), file, runs


def lasting(verdict: Verdict) -> str:
    """What stays the same where the same runs are fitted again."""
    return verdict.model_copy(update=PASSING).to_json()


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a pendulum that rubs, its runs and its fit."""
    folder = tmp_path_factory.mktemp("rubbing")
    fitted(folder, dry, 1)
    return folder


@pytest.fixture
def copied(rubbing: Path, tmp_path: Path) -> tuple[Path, Path]:
    """A file and a fit of it that a test may change."""
    file, out = tmp_path / "pendulum.yaml", tmp_path / "out"
    for name in ("pendulum.yaml", "model.xml"):
        (tmp_path / name).write_bytes((rubbing / name).read_bytes())
    out.mkdir()
    for name in ("fit.json", "patch.yaml", MODEL_PATCH, "verdict.json"):
        (out / name).write_bytes((rubbing / "out" / name).read_bytes())
    return file, out


def test_hidden_dry_friction_is_named(rubbing: Path) -> None:
    verdict = read_verdict(rubbing / "out" / "verdict.json")
    assert verdict.verdict == "named"
    (effect,) = verdict.effects
    assert effect.name == "dry_friction"
    assert effect.parameters["torque_1"].value == pytest.approx(4e-4, rel=0.05)
    assert verdict.gap.after["angle_mrad"] == pytest.approx(1.0, rel=0.1)
    assert verdict.gap.shrink > 0.8


def test_verdict_file_is_the_contract_and_holds_only_numbers(rubbing: Path) -> None:
    text = (rubbing / "out" / "verdict.json").read_text()
    verdict = json.loads(
        text, parse_constant=lambda word: pytest.fail(f"{word} in verdict.json")
    )
    assert list(verdict) == [
        "schema",
        "verdict",
        "effects",
        "ambiguous",
        "unexplained",
        "base",
        "where",
        "gap",
        "candidates",
        "advice",
        "detectable",
        "held_out",
        "runtime",
        "simulations",
        "posterior",
        "notes",
        "next",
    ]
    assert verdict["schema"] == 1
    assert list(verdict["effects"][0]) == ["name", "of", "parameters", "confidence"]
    assert verdict["effects"][0]["of"] == "strip"
    assert set(verdict["effects"][0]["parameters"]["torque_1"]) == {
        "value",
        "low",
        "high",
        "unit",
    }
    assert set(verdict["base"]["damping_1"]) == {"value", "low", "high"}
    assert list(verdict["where"][0]) == [
        "channel",
        "phase",
        "zone",
        "condition",
        "z",
        "p",
    ]
    assert list(verdict["gap"]) == [
        "before",
        "after",
        "floor",
        "shrink",
        "shrink_low",
        "shrink_high",
    ]
    assert set(verdict["gap"]["before"]) == {"angle_mrad", "excess"}
    assert list(verdict["candidates"][0]) == [
        "name",
        "elpd_gain",
        "se",
        "p",
        "invariance_p",
        "parameters",
    ]


@pytest.mark.slow
def test_same_verdict_whatever_the_number_of_jobs(
    rubbing: Path, tmp_path: Path
) -> None:
    two = fit(
        [rubbing / "runs"],
        rubbing / "pendulum.yaml",
        tmp_path / "out",
        FitOptions(jobs=2),
    )
    one = read_verdict(rubbing / "out" / "verdict.json")
    assert lasting(one) == lasting(two)


@pytest.mark.slow
def test_interrupted_fit_leaves_no_verdict_and_is_made_again(
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
    assert lasting(whole) == lasting(fit(runs, file, out))


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


def test_accepted_effect_leaves_no_gap(
    rubbing: Path, copied: tuple[Path, Path]
) -> None:
    file, out = copied
    accepted = accept(out, file)
    assert accepted.effects == ("dry_friction",)
    pendulum = load(file, MechanismFile)
    assert pendulum.effects["dry_friction"]["torque_1"] == pytest.approx(4e-4, rel=0.05)
    notes = {note.key: note.note for note in pendulum.provenance}
    assert notes["damping_1"].startswith("was 0.00025, is ")
    again = fit([rubbing / "runs"], file, out.parent / "again")
    assert again.verdict == "no_gap"
    assert again.base["dry_friction.torque_1"].value == pytest.approx(4e-4, rel=0.05)
    assert [name for name in again.base if "." in name] == ["dry_friction.torque_1"]


def test_a_file_that_was_edited_is_neither_accepted_into_nor_undone(copied) -> None:
    file, out = copied
    stated = file.read_text()
    file.write_text(f"{stated}# a word\n")
    with pytest.raises(ConfigurationError, match="has changed since it was fitted"):
        accept(out, file)
    file.write_text(stated)
    accept(out, file)
    file.write_text(file.read_text() + "# a word\n")
    with pytest.raises(ConfigurationError, match="has changed since the acceptance"):
        undo(out, file)


def test_effects_of_the_cell_go_into_the_cell_file(copied: tuple[Path, Path]) -> None:
    file, out = copied
    cell = out.parent / "cell.yaml"
    stated = yaml.safe_load((CHECKOUT_CONFIGS / "cell.yaml").read_text())
    here = {"name": "here", "effects": {"desk_tilt": {"angle": 0.001}}}
    cell.write_text(yaml.safe_dump(stated | here))
    contents = {
        "subject": (out / "patch.yaml").read_bytes(),
        "cell": "effects:\n  camera_latency: {time: 0.02}\n",
    }
    write_fit(out, file, "accept", contents)
    with pytest.raises(ConfigurationError, match="name the cell file"):
        accept(out, file)
    accept(out, file, cell)
    content = yaml.safe_load(cell.read_text())
    assert content["effects"] == {
        "desk_tilt": {"angle": 0.001},
        "camera_latency": {"time": 0.02},
    }
    assert content["name"] == "here"
    undo(out, file, cell)
    assert yaml.safe_load(cell.read_text())["effects"] == {
        "desk_tilt": {"angle": 0.001}
    }


def test_swings_with_nothing_hidden_show_no_gap(tmp_path: Path) -> None:
    verdict, _, _ = fitted(tmp_path, None, 2)
    assert verdict.verdict == "no_gap"
    assert verdict.effects == []
    assert 0.0 < verdict.detectable["dry_friction"] < 4e-4
    assert not (tmp_path / "out" / "patch.yaml").exists()
    with pytest.raises(ConfigurationError, match="nothing was named"):
        accept(tmp_path / "out", tmp_path / "pendulum.yaml")


@pytest.mark.slow
def test_drag_of_one_link_cannot_be_told_from_a_quadratic_hinge(tmp_path: Path) -> None:
    verdict, _, _ = fitted(tmp_path, drag, 3)
    assert verdict.verdict == "ambiguous"
    assert verdict.ambiguous == [["air_drag", "quadratic_damping"]]
    assert verdict.effects == []
