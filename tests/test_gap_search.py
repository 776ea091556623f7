"""Which models are worth refitting after others were."""

from cell.gap.search import exhausted, without_each
from tests.test_gap_engine import Curves, Law, bump, hidden, wave
from tests.test_gap_engine import fitted as at
from tests.test_gap_robust import validated

BOTH: Law = lambda t, s, i: 0.2 * bump(t, s, i) - 0.15 * wave(t, s, i)  # noqa: E731
FAINT: Law = lambda t, s, i: 2.0 * bump(t, s, i) - 0.002 * wave(t, s, i)  # noqa: E731


def test_nothing_is_searched_beside_what_leaves_too_little() -> None:
    for law, done in ((hidden(bump, 0.2), True), (FAINT, True), (BOTH, False)):
        subject = Curves(law)
        pool = [validated(at(subject, names), subject) for names in ((), ("bump",))]
        assert exhausted(pool) is done


def test_a_base_is_never_exhausted() -> None:
    subject = Curves(hidden(bump, 0.2))
    assert not exhausted([validated(at(subject), subject)])


def test_singles_begin_again_from_a_better_pair_though_it_was_not_accepted() -> None:
    subject = Curves(hidden(bump, 0.2))
    base, pair = (validated(at(subject, n), subject) for n in ((), ("bump", "wave")))
    scores = without_each([base, pair])
    assert [s.names for s in scores[-2:]] == [("wave",), ("bump",)]
    assert all(s.after is pair.estimate for s in scores)
    assert [s.names for s in without_each([base])] == []
