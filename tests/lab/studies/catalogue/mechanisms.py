"""Study of what `cell gap` says of chains of two to seven joints and of a pendulum on a cart.

As the study `foreign`, with models that come with the exam.
"""

from dataclasses import replace

import numpy as np

from tests.lab.exam.mechanisms import LISTS
from tests.lab.studies.catalogue import foreign
from tests.lab.studies.study import Values


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw what is hidden, a fifth of each kind, in one of the chains."""
    return foreign.draw_in({name: {} for name in LISTS["chains"]}, number, rng)


def measure(case: Values) -> Values:
    """Score the verdict on a case; also returns its processor time `cpu` [s]."""
    return foreign.measure(case)


STUDY = replace(
    foreign.STUDY,
    name="mechanisms",
    question="What does `cell gap` say of causes hidden in chains of two to seven joints?",
    draw=draw,
    measure=measure,
    ledger=None,
)
