"""Generic law terms of a strip: they describe unexplained residuals and are never named causes."""

import numpy as np

from cell.gap.subject.subject import Candidate, Parameter
from drivers.strip.law import LAW_TERMS, Term

SECANT = 0.1  # of a term's size: the step of finite differences
TRIED = (0.0, 0.5, 0.9)  # probes between a term's size and its maximum, on a logarithmic scale


def candidates() -> tuple[Candidate, ...]:
    """Candidates for all generic law terms, each with its amount as the only parameter."""
    return tuple(_candidate(term) for term in LAW_TERMS.values())


def _candidate(term: Term) -> Candidate:
    step = SECANT * term.size
    amount = Parameter("amount", term.unit, 0.0, term.low, term.most, step=step, spread=term.most)
    sizes = term.size * (term.most / term.size) ** np.array(TRIED)
    probes = tuple(((float(size),),) for size in sizes)
    return Candidate(term.name, term.sentence, "strip", (amount,), probes)
