"""What could be gained by pairs of effects, and which of them are looked at closely."""

from itertools import combinations, product

import numpy as np
import pytest

from cell.gap.fitting import normal_equations
from cell.gap.fitting.projection import projection
from cell.gap.fitting.tasks import rough, run_all, run_one
from cell.gap.selection.screening import Table, _best_mix, probe, ranked_pairs, ranking, table
from tests.cell.gap.test_gap_engine import Curves, bump, fitted, hidden, wave


@pytest.fixture(scope="module")
def screened() -> Table:
    subject = Curves(lambda t, s, i: 0.2 * bump(t, s, i) - 0.15 * wave(t, s, i))
    base = fitted(subject)
    probes = run_all(subject.simulate, [probe(base, c) for c in subject.scope.candidates])
    return table(projection(base), probes)


def test_no_mix_gains_more_than_its_groups_could(screened: Table) -> None:
    for members in [*((p,) for p in screened.probed), *combinations(screened.probed, 2)]:
        most = screened.most(members)
        for choice in product(*(range(len(p.groups)) for p in members)):
            found, whole, _ = _best_mix(screened, members, choice)
            assert max(found.gain, whole) <= most[choice] * (1.0 + 1e-6)


def test_bound_of_a_pair_is_what_both_gain_without_bounds(screened: Table) -> None:
    a, b = screened.probed[:2]
    at = np.concatenate([screened.columns[p.candidate.name, 1] for p in (a, b)])
    form = normal_equations.Normal(
        screened.form.gradient[at], screened.form.curvature[np.ix_(at, at)]
    )
    free = -np.linalg.solve(form.curvature, form.gradient)
    assert screened.most((a, b))[1, 1] == pytest.approx(normal_equations.decrease(form, free))


def test_best_score_is_the_best_of_all_groups(screened: Table) -> None:
    for score in [*ranking(screened), *ranked_pairs(screened, 3)]:
        members = [p for n in score.names for p in screened.probed if p.candidate.name == n]
        every = product(*(range(len(p.groups)) for p in members))
        gains = [_best_mix(screened, members, choice)[0].gain for choice in every]
        assert score.gain == pytest.approx(max(gains))


def test_what_may_be_there_besides_speaks_for_no_effect_like_it() -> None:
    """Sherman and Morrison: beside a response of one sigma both shrink by 1 + its square."""
    subject = Curves(hidden(bump, 0.2))
    base = fitted(subject)
    bumps = next(c for c in subject.scope.candidates if c.name == "bump")
    response = run_one(subject.simulate, probe(base, bumps)).responses[1]
    plain, wary = projection(base), projection(base, nuisance=[response])
    before, after = (about.form(about.weigh(response)) for about in (plain, wary))
    square = before.curvature[0, 0]
    assert after.curvature[0, 0] == pytest.approx(square / (1.0 + square))
    assert after.gradient[0] == pytest.approx(before.gradient[0] / (1.0 + square))


def test_pairs_that_gain_too_little_are_not_told(screened: Table) -> None:
    best = ranked_pairs(screened, 1)[0].gain
    assert ranked_pairs(screened, 3, 0.99 * best)
    assert not ranked_pairs(screened, 3, 1.01 * best)


def test_a_rough_simulation_is_asked_for_by_what_is_run_on_it() -> None:
    subject = Curves(hidden(bump, 0.2))
    base = fitted(subject)
    asked = []

    def simulate(requests):
        asked.extend(requests)
        return subject.simulate(requests)

    moved = responses(run_one(rough(simulate), probe(base, subject.scope.candidates[0])))
    assert asked
    assert all(request.rough for request in asked)
    plain = responses(run_one(subject.simulate, probe(base, subject.scope.candidates[0])))
    np.testing.assert_array_equal(moved, plain)


def responses(probed) -> np.ndarray:
    return np.concatenate(probed.responses, axis=1)
