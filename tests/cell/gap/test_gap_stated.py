"""Refitted values that leave what the file states are a finding: said first, offered,
accepted.
"""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from cell.gap.fit import FitOptions, fit
from cell.gap.report.page import _provenance
from cell.gap.report.sentence import deviation_text, headline
from cell.gap.subject.strip.scope import scope
from cell.gap.verdict.accept import accept
from cell.gap.verdict.compose import deviations
from cell.gap.verdict.schema import Interval, NamedEffect
from drivers.strip.describe import load_strip
from drivers.strip.effects.effect import Parameter
from tests.support.fit_folders import Fitted, verdict_of, write_fit
from tests.support.gap_strip_cases import STRIP, denim, folds, written

LENGTH = Parameter(
    "bending_length", "m", 0.017, 0.005, 0.05, 1e-5, 0.0085, tolerated=(0.015, 0.02)
)
TIME = Parameter("retardation_time", "s", 0.03, 0.001, 1.0, 1e-4, 0.06)


def found(low: float | None, value: float, high: float | None) -> dict[str, Interval]:
    return {"bending_length": Interval(value=value, low=low, high=high)}


def test_a_value_whose_interval_leaves_what_is_tolerated_deviates() -> None:
    (far,) = deviations([LENGTH, TIME], found(0.0287, 0.0289, 0.0291))
    assert far.model_dump(exclude={"low", "high"}) == {
        "parameter": "bending_length",
        "stated": 0.017,
        "value": 0.0289,
        "unit": "m",
        "tolerated": (0.015, 0.02),
    }


@pytest.mark.parametrize(
    "interval",
    [
        (0.0190, 0.0191, 0.0192),
        (0.019, 0.024, 0.029),
        (None, 0.0289, None),
        (0.0199, 0.03, None),
    ],
)
def test_a_value_that_may_lie_within_the_tolerance_does_not_deviate(interval) -> None:
    assert not deviations([LENGTH, TIME], found(*interval))


def test_without_a_stated_range_two_standard_deviations_are_tolerated() -> None:
    wide, far = (
        Interval(value=v, low=v - 0.001, high=v + 0.001) for v in (0.149, 0.16)
    )
    assert not deviations([TIME], {"retardation_time": wide})
    assert deviations([TIME], {"retardation_time": far})


def test_an_inverse_parameter_is_tolerated_as_files_state_it() -> None:
    slip = Parameter("end_slip.friction", "1", 2.0, 0.0, 10.0, 0.1, 0.5, inverse=True)
    inside, outside = (Interval(value=v, low=v, high=v) for v in (0.9, 1.2))
    assert not deviations([slip], {slip.name: inside})
    assert deviations([slip], {slip.name: outside})[0].stated == 0.5


def test_what_a_file_has_already_is_refitted_and_not_named_again() -> None:
    effects = {"air_drag": {"coefficient": 2.0}}
    known = scope(denim().model_copy(update={"effects": effects}))
    assert "air_drag" not in [each.name for each in known.candidates]
    assert "air_drag.coefficient" in [p.name for p in known.base]


def test_a_strip_file_s_own_spread_is_its_tolerance() -> None:
    plain = {p.name: p for p in scope(denim()).base}
    assert plain["bending_length"].tolerated == pytest.approx((0.01445, 0.01955))
    assert plain["retardation_time"].tolerated is None
    spread = {"bending_length": (0.010, 0.030), "retardation_time": (0.01, 0.04)}
    stated = scope(denim().model_copy(update={"spread": spread})).base
    assert [p.tolerated for p in stated] == [(0.010, 0.030), (0.01, 0.04)]


FAR = deviations([LENGTH], found(0.0287, 0.0289, 0.0291))


def test_what_deviates_is_said_before_the_verdict() -> None:
    assert deviation_text(FAR).startswith("not as the file states: bending length 28.9")
    assert "the file states 17" in deviation_text(FAR)
    said = str(verdict_of(deviates=FAR, notes=["03: died after 2.1 s"]))
    assert said == "no gap\n  note: 03: died after 2.1 s"
    assert headline(verdict_of(deviates=FAR)).startswith(
        "Not as the file states: bending length"
    )


def test_a_headline_shows_the_joint_at_which_an_effect_is_and_no_shape() -> None:
    shown = {"torque_1": (0.05, "N m"), "rate_1": (0.5, "rad/s")}
    values = {
        name: Interval(value=v, low=v - 0.1, high=v + 0.1, unit=unit)
        for name, (v, unit) in {**shown, "torque_2": (0.6, "N m")}.items()
    }
    effect = NamedEffect(name="rub", of="model", parameters=values, confidence=0.9)
    said = headline(verdict_of(verdict="named", effects=[effect]))
    assert said.startswith("rub: torque 2 0.6")


def test_values_are_accepted_where_nothing_is_named_and_come_back(tmp_path) -> None:
    made = Fitted(tmp_path)
    before = made.file.read_bytes()
    patch = yaml.safe_load(made.file.read_text()) | {"bending_length": 0.0289}
    values = {"subject": yaml.safe_dump(patch)}
    stated = {"effects": (), "values": ("b",)}
    write_fit(made.out, made.file, "accept_values", values, **stated)
    assert made.accept().effects == ("b",)
    assert load_strip(made.file).bending_length == 0.0289
    assert made.undo().effects == ("b",)
    assert made.file.read_bytes() == before


@pytest.mark.long
def test_runs_of_another_strip_are_a_finding_and_its_patch_is_accepted(
    tmp_path: Path,
) -> None:
    """Issue 36, item 7: bending length 28.9 mm under a header that says 17.0."""
    names = ("normal", "fast", "slow-low", "normal")
    runs, out, file = (tmp_path / name for name in ("runs", "out", "denim.yaml"))
    written(runs, folds(names, bending_length=0.0289))
    file.write_bytes(STRIP.read_bytes())
    verdict = fit([runs], file, out, FitOptions(jobs=2))
    assert [d.parameter for d in verdict.deviates] == ["bending_length"]
    assert verdict.verdict == "no_gap"
    assert not (out / "patch.yaml").exists()
    assert "Not as the file states" in (out / "report.html").read_text()
    accept(out, file)
    assert load_strip(file).bending_length == pytest.approx(0.0289, rel=0.02)
    again = fit([runs], file, tmp_path / "again", FitOptions(jobs=2))
    assert not again.deviates


def test_a_page_says_which_motions_judged() -> None:
    runs = [SimpleNamespace(name=n, condition=c) for n, c in ("a1", "b2")]
    findings: Any = SimpleNamespace(subject=SimpleNamespace(runs=runs))
    assert _provenance(findings, verdict_of(held_out=["b"])).endswith("Held out: 2.")
