"""The gap engine on a subject of plain curves: it knows nothing of strips or
pendulums.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.gap.diagnosis.held_out_gap import odd_runs
from cell.gap.diagnosis.lack_of_fit import Repeats, can_be_ordered, order_suspicion
from cell.gap.fitting.base_fit import undetermined_values
from cell.gap.fitting.crossvalidation import folds
from cell.gap.report.sentence import sentence
from cell.gap.subject.subject import Origin
from cell.gap.verdict.decision import next_steps
from drivers.base.types import Array
from drivers.strip.effects.effect import Parameter
from tests.support.curves import (
    Curves,
    Law,
    both,
    bump,
    fitted,
    hidden,
    judged,
    nothing,
    validated,
    wave,
)


def test_hidden_effect_is_named_with_an_interval_that_covers_it_beside_one_that_does_nothing():
    found, verdict = judged(Curves(hidden(bump, 0.05)))
    assert verdict.verdict == "named"
    (effect,) = verdict.effects
    size = effect.parameters["size"]
    assert effect.name == "bump"
    assert size.low < 0.05 < size.high
    assert verdict.gap.after["angle_mrad"] == pytest.approx(10.0, rel=0.1)
    assert verdict.gap.shrink > 0.8
    assert verdict.posterior.inclusion["bump"] > 0.99
    assert verdict.unexplained is None
    advised, longer = verdict.model_dump()["advice"]
    assert list(advised) == ["experiment", "separates", "expected_sigma", "minutes"]
    assert advised["minutes"] < longer["minutes"]
    assert [p.name for p in found.screen.probed if p.dead] == ["dead"]
    assert "dead" not in verdict.detectable


def test_nothing_hidden_is_no_gap_with_detectable_sizes() -> None:
    verdicts = [judged(Curves(nothing, seed=seed))[1] for seed in range(12)]
    assert sum(v.verdict == "no_gap" for v in verdicts) >= 11
    assert not any(v.effects for v in verdicts)
    assert 0.0 < verdicts[0].detectable["bump"] < 0.02


def test_without_a_gap_it_is_told_what_could_not_be_looked_for() -> None:
    _, once = judged(Curves(nothing, names=("bump", "dead"), repeats=1))
    assert [*map(str, once.untested)] == [
        "drift (no condition was repeated: a drift could not be looked for)",
        "dead (shows at no possible size)",
    ]
    assert "not tested: drift (no condition was repeated" in str(once)
    _, repeated = judged(Curves(nothing, names=("bump",)))
    assert repeated.verdict == "no_gap"
    assert "untested" not in json.loads(repeated.to_json())


def test_an_effect_that_shows_beyond_its_usual_size_alone_was_not_tested() -> None:
    findings, verdict = judged(Curves(nothing, names=("bump",)))
    limit = verdict.detectable["bump"]
    (effect,) = findings.scope.candidates
    assert replace(effect, usual=2.0 * limit).is_usual(limit)
    assert not replace(effect, usual=0.5 * limit).is_usual(limit)


def test_a_gap_of_held_out_runs_alone_is_noted() -> None:
    _, plain = judged(Curves(nothing))
    only = {int(name[1:]) for name in plain.held_out}
    found, verdict = judged(Curves(lambda t, s, i: 0.03 * bump(t, s, i) * (i in only)))
    assert verdict.verdict == "no_gap"
    (note,) = verdict.notes
    excess = verdict.gap.before["excess"]
    assert f"({', '.join(plain.held_out)}) lie {excess:.2g} sigma off" in note
    assert "make these motions again" in note
    # what the note asks for is not denied by the step that follows
    (step,) = next_steps(found.decision, verdict, Path("out"), Origin("--strip"))
    assert step.kind == "repeat"


def test_detectable_size_is_found_when_it_is_there() -> None:
    size = judged(Curves(nothing))[1].detectable["bump"]
    found = [judged(Curves(hidden(bump, size), seed=seed))[1] for seed in range(1, 6)]
    assert sum([e.name for e in v.effects] == ["bump"] for v in found) >= 4


def test_a_small_effect_beside_a_strong_one_is_found_where_all_residuals_show_no_gap():
    for seed in range(3):
        _, verdict = judged(Curves(both(0.2, -0.006), seed=seed))
        assert sorted(e.name for e in verdict.effects) == ["bump", "wave"]


def test_what_no_other_stands_in_for_is_named_beside_twins_at_its_value_beside_them():
    found, verdict = judged(Curves(both(0.2, -0.03), names=("bump", "twin", "wave")))
    assert verdict.verdict == "named"
    assert verdict.ambiguous == [["bump", "twin"]]
    (effect,) = verdict.effects
    size = effect.parameters["size"]
    assert effect.name == "wave"
    assert size.low < -0.03 < size.high
    assert "cannot tell apart: bump or twin (the numbers are with " in sentence(
        found, verdict
    )
    assert verdict.gap.shrink > 0.9


def test_specimen_that_drifts_from_run_to_run_is_not_called_in_order() -> None:
    found, verdict = judged(Curves(lambda t, _, i: 0.02 * i * t))
    assert verdict.verdict == "unexplained"
    assert "slope" in found.base_fit.repeats.drift


UNEXPLAINED = {
    "cause outside the library": Curves(
        lambda t, s, i: 0.2 * np.exp(-(((t - 0.8) / 0.03) ** 2))
    ),
    "proxy whose amplitude drifts between conditions": Curves(
        lambda t, s, i: 0.1 * bump(t, 1.0, i) * (1.0 if s < 1.5 else -1.0), repeats=3
    ),
    "wrong sign of a one-sided effect": Curves(hidden(bump, -0.05), signed=False),
}


@pytest.mark.parametrize("what", UNEXPLAINED)
def test_what_no_effect_does_is_unexplained(what: str) -> None:
    _, verdict = judged(UNEXPLAINED[what])
    assert verdict.verdict == "unexplained"
    assert verdict.effects == []


def test_strongest_place_is_where_the_effect_was_hidden() -> None:
    found, _ = judged(Curves(lambda t, s, _: 0.05 * ((t > 0.6) & (s > 2.5))))
    first = found.base_fit.places[0]
    assert (first.phase, first.condition) == ("fall", "faster")
    assert first.p < 0.01


def test_scatter_between_repeats_raises_the_noise() -> None:
    fits = [fitted(Curves(nothing, seed=seed)) for seed in range(8)]
    loud = [replace(fit, residuals=[3.0 * r for r in fit.residuals]) for fit in fits]
    by_fit = [Repeats.of(fit).scatter["angle"] for fit in loud]
    assert 2.3 < np.mean(by_fit) < 3.0  # each run's own shift takes some of it
    assert Repeats.of(fits[0]).scatter["angle"] == pytest.approx(1.0)


def test_conditions_that_follow_one_another_are_no_drift() -> None:
    wrong = Curves(lambda t, speed, _: 0.3 * speed * t, scatter=0.02)
    assert not Repeats.of(fitted(wrong)).drifts


def test_a_run_that_is_left_out_settles_among_the_values_of_the_others() -> None:
    fit = validated(fitted(Curves(nothing, noise=1e-3)))
    assert max(abs(r.mean()) for r in fit.left_out) < 0.5


def test_conditions_are_never_split_between_folds() -> None:
    runs = Curves(nothing, repeats=3).runs
    inside = [{runs[i].condition for i in fold} for fold in folds(runs)]
    assert sum(map(len, inside)) == len(set().union(*inside))


def test_value_that_the_runs_cannot_determine_is_named_and_a_run_that_diverged_predicted():
    subject = Curves(nothing)
    shift = Parameter("shift", "m", step=1e-4)
    subject.runs = [replace(run, local=[shift]) for run in subject.runs]
    fit = fitted(subject)
    assert [p.name for p, _ in undetermined_values(fit)] == ["offset"]
    blind = replace(fit, jacobians=(fit.jacobians[0] * [1, 1, 0], *fit.jacobians[1:]))
    assert np.isfinite(validated(blind).left_out[0]).all()


def test_wild_samples_do_not_move_the_fit() -> None:
    subject = Curves(nothing)
    for run in subject.runs:
        run.content[1][::20] += 3.0
    assert fitted(subject).shared[1] == pytest.approx(0.5, abs=0.02)


def ageing(t: Array, speed: float, index: int) -> Array:
    """A slope and a bump that both grow from run to run."""
    return 0.02 * index * (t + bump(t, speed, index))


def follows_order(law: Law, seed: int = 0, repeats: int = 2) -> str:
    subject = Curves(law, seed=seed, repeats=repeats)
    return order_suspicion(fitted(subject, ["bump"]), np.random.default_rng(0))


def test_values_that_follow_the_order_of_runs_are_told_and_chance_is_not() -> None:
    told = follows_order(ageing)
    assert "order of the runs" in told
    assert "rises: what warms, wears or ages?" in told
    assert not follows_order(lambda t, _, index: 0.02 * index * t)  # one value alone
    assert [follows_order(nothing, seed) for seed in range(12)].count("") >= 11
    assert not follows_order(ageing, repeats=1)  # too few runs
    assert [can_be_ordered(Curves(nothing, repeats=n).runs) for n in (1, 2)] == [0, 1]


def test_a_run_that_contradicts_the_others_is_named() -> None:
    subject = Curves(lambda t, _, index: 0.2 * (index == 5) * wave(t, 1.0, 0))
    (told,) = odd_runs(fitted(subject), subject.scope.quantities)
    assert told.startswith("r5: contradicts the others")
    sound = fitted(Curves(nothing))
    shares = [1.0, *[0.1] * (len(sound.runs) - 1)]  # of the stated noise
    quiet = [share * r for share, r in zip(shares, sound.residuals, strict=True)]
    for fit in (sound, replace(sound, residuals=quiet)):
        assert not [*odd_runs(fit, subject.scope.quantities)]
