"""Laws of a strip as the engine tries them: they describe, and never name, what is left."""

from cell.gap.subject.subject import Candidate, Parameter
from drivers.strip.law import TERMS, Term

LARGER = 10.0  # times its size: the farthest that a law is taken
ONE_SIGNED = frozenset({"term_rate", "term_sign", "term_speed"})
"""Laws that only ever take energy out: their amounts are not negative."""


def candidates() -> tuple[Candidate, ...]:
    """Every law, with one amount each."""
    return tuple(_candidate(term) for term in TERMS.values())


def _candidate(term: Term) -> Candidate:
    reach = LARGER * term.size
    low = 0.0 if term.name in ONE_SIGNED else -reach
    amount = Parameter("amount", term.unit, 0.0, low, reach, 0.1 * term.size, reach)
    return Candidate(term.name, term.sentence, "strip", (amount,), (((term.size,),),))
