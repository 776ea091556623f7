"""Generic laws of a strip as terms: they describe an unexplained rest, and are never named."""

import numpy as np

from cell.gap.subject.subject import Candidate, Parameter
from drivers.strip.law import LAW_TERMS, Term

SECANT = 0.1  # of its size: the step of secants
TRIED = (0.0, 0.5, 0.9)  # of the way from its size to the most, on a logarithmic scale


def candidates() -> tuple[Candidate, ...]:
    """Every law, with one amount each."""
    return tuple(_candidate(term) for term in LAW_TERMS.values())


def _candidate(term: Term) -> Candidate:
    step = SECANT * term.size
    amount = Parameter("amount", term.unit, 0.0, term.low, term.most, step, term.most)
    sizes = term.size * (term.most / term.size) ** np.array(TRIED)
    probes = tuple(((float(size),),) for size in sizes)
    return Candidate(term.name, term.sentence, "strip", (amount,), probes)
