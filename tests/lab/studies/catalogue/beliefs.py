"""Study of the prior beliefs of `cell gap`: which of them make the hidden effects most
probable.

Cases from the state hide nothing, one effect of the library, or two, at all strengths
of the exam. The posterior over the sets that an investigation fits, and over the most
promising effects where it sees no reason to fit any, is taken anew for each choice of
two numbers: the share of the floor that an immaterial effect fills, and that by which a
law is wrong.
"""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from threadpoolctl import threadpool_limits

from cell.base.config.places import find_configs
from cell.gap.fitting import quiet
from cell.gap.investigate import investigate
from cell.gap.open_subject import open_subject
from cell.gap.selection.hold_out import held_out
from cell.gap.selection.likelihood import Fits
from cell.gap.selection.posterior import Beliefs, Posterior, posterior
from cell.gap.selection.search import BUDGET, Search
from cell.gap.subject.run_folders import find_runs
from cell.gap.verdict.findings import Findings
from tests.lab.exam.case import Case
from tests.lab.exam.cases import draw_case
from tests.lab.exam.from_state import make_runs
from tests.lab.exam.score import with_twins
from tests.lab.studies.study import Fit, Outcome, Quantity, Statistic, Study, Values

IMMATERIAL = (0.02, 0.04, 0.06, 0.09, 0.12, 0.18)
WRONG_SIGMAS = (0.05, 0.1, 0.2)
SILENT = 0.01  # nats a case, by less than which they say nothing about a number
LAPSE = 0.01  # share of cases of which no model speaks: bounds what one of them counts
TURN, PAIRS = 4, 4  # a turn hides nothing, then each strength; one in four hides pairs


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw the kind of a case: nothing, one effect or two; its number gives their
    strength.
    """
    turn, place = divmod(number, TURN)
    seed = int(rng.integers(2**31))
    if place == 0:
        return {"kind": "nothing", "number": turn, "seed": seed}
    kind = "pair" if turn % PAIRS == PAIRS - 1 else "single"
    return {"kind": kind, "number": (TURN - 1) * turn + place - 1, "seed": seed}


def measure(case: Values) -> Values:
    """Log score [nats] of the hidden effects under each choice of the beliefs."""
    hidden = draw_case("state", case["kind"], case["number"], case["seed"])
    strip = find_configs(None).strip_path(hidden.strip)
    with TemporaryDirectory() as name, threadpool_limits(1, "blas"):
        make_runs(hidden, Path(name))
        subject = open_subject(strip, find_runs([Path(name)]), jobs=1)
        held = held_out(subject, subject.simulate)
        found = investigate(subject, held, subject.simulate, quiet)
        fits = _fit_promising(found)
    scores = [
        {"immaterial": i, "wrong": w, "nats": log_score(_weigh(fits, i, w), hidden)}
        for i, w in product(IMMATERIAL, WRONG_SIGMAS)
    ]
    return {
        "answer": list(hidden.answer),
        "strength": hidden.strength,
        "named": sorted(found.accepted.model.names),
        "log_score": log_score(posterior(fits, fits.likelihood), hidden),
        "best": max(score["nats"] for score in scores),
        "scores": scores,
    }


def _fit_promising(found: Findings) -> Fits:
    """Fits of an investigation, with those of the most promising single effects in any
    case.

    Where nothing is hidden, the screen often leaves only the base, of which any beliefs
    are sure.
    """
    scope, fits = found.subject.scope, found.fits
    missing = [
        s
        for s in found.screen.singles[: BUDGET.singles]
        if fits.of(frozenset(s.names)) is None
    ]
    search = Search(found.subject.simulate, scope.candidates, ())
    return search.fit_scored_models(fits, missing)


def _weigh(fits: Fits, immaterial: float, wrong: float) -> Posterior:
    prior = Beliefs.shipped().model_copy(
        update={"immaterial": immaterial, "wrong": wrong}
    )
    return posterior(fits, fits.likelihood, prior)


def log_score(sets: Posterior, hidden: Case) -> float:
    """Logarithm [nats] of the probability of the hidden effects; a twin counts as the
    effect.

    The score is proper (Gneiting and Raftery 2007, J. Am. Stat. Assoc. 102, 359), but
    for the share LAPSE, without which a case whose truth was never fitted would decide
    alone.
    """
    right = with_twins(frozenset(hidden.answer))
    p = sum(model.p for model in sets.models if model.names in right)
    return float(np.log(LAPSE + (1.0 - LAPSE) * p))


def fit_beliefs(outcomes: Sequence[Outcome]) -> Values:
    """Beliefs of the highest mean log score; a number of which the cases say nothing is
    kept.
    """
    present = Beliefs.shipped()

    def mean(immaterial: float, wrong: float) -> float:
        return float(np.mean([_nats(o, immaterial, wrong) for o in outcomes]))

    immaterial, wrong = max(
        product(IMMATERIAL, WRONG_SIGMAS), key=lambda each: mean(*each)
    )
    highest = mean(immaterial, wrong)
    if (
        present.wrong in WRONG_SIGMAS
        and mean(immaterial, present.wrong) > highest - SILENT
    ):
        wrong = present.wrong
    if (
        present.immaterial in IMMATERIAL
        and mean(present.immaterial, wrong) > highest - SILENT
    ):
        immaterial = present.immaterial
    tried = ", ".join(f"{i} {mean(i, wrong):.3f}" for i in IMMATERIAL)
    others = ", ".join(f"{w} {mean(immaterial, w):.3f}" for w in WRONG_SIGMAS)
    source = (
        f"mean log score [nats] of what is hidden by immaterial: {tried}; by wrong:"
        f" {others}; the rest from a prototype on thirteen cases;"
    )
    fitted = {"immaterial": immaterial, "wrong": wrong, "source": source}
    return present.model_copy(update=fitted).model_dump(mode="json", by_alias=True)


def _nats(outcome: Outcome, immaterial: float, wrong: float) -> float:
    return next(
        float(score["nats"])
        for score in outcome.values["scores"]
        if (score["immaterial"], score["wrong"]) == (immaterial, wrong)
    )


STUDY = Study(
    name="beliefs",
    question="Which prior beliefs make the effects that are hidden the most probable?",
    draw=draw,
    measure=measure,
    by=("kind",),
    quantities=(
        Quantity("log_score", Statistic.MEAN, "nats", 1.0),
        Quantity(
            "best",
            Statistic.MEAN,
            "nats",
            1.0,
            label="at the best beliefs of each case",
        ),
    ),
    fits=(Fit("cell/gap/selection/beliefs.yaml", fit_beliefs),),
    usual=48,
    quick=1,
    seconds=60.0,
)
