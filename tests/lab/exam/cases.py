"""Cases of an exam: drawn at random from a seed, and scaled to a strength."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from cell.base.config.places import find_configs
from cell.gap.effect_size import GapModel, draw_strengths
from cell.gap.subject.strip.synthetic import BENCH, planned_runs, reported_path
from cell.record.header import Sigma
from drivers.base.errors import Fault
from drivers.base.types import Array
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Effect
from drivers.strip.file import StripFile
from policies.experiments.motion import human_motion
from policies.experiments.standard import standard_order
from tests.lab.exam.case import (
    STRENGTHS,
    Case,
    Kind,
    ScatterLevel,
    Strength,
    Tier,
    Values,
)
from tests.lab.exam.causes import causes
from tests.lab.exam.from_state import MOTIONS, paths_by_hand, scale_strip
from tests.lab.exam.through_images import refusal

TRIES = 60  # draws of an effect until one can be as strong as asked
PLACE_DRAWS = 4  # draws of an effect's place on each strip
JUMP = 1.5  # times the asked gap, beyond which an effect is nearer to the next strength
# share of medium strength that each of two effects must keep beside the other
NEARLY = 0.9
# one state-based case in so many has a plant that is not the model: a chain
FOREIGN = 2
BY_HAND_PERIOD = 3  # one triple of levels in so many is moved by hand
STIFFER, SLOWER = 1.15, 2.0  # factors by which a plant's base may differ from its file
CASE_STRENGTHS: tuple[Strength, ...] = ("weak", "medium", "strong")
SCATTER: tuple[ScatterLevel, ...] = ("none", "half", "full")
# one in so many rounds of levels and engines has laws that only resemble
UNLIKE_PERIOD = 2
CAUSE_NAMES = sorted(name for name, cause in causes().items() if cause.sizes)
RESEMBLING = {cause.answers: name for name, cause in causes().items() if cause.answers}


def draw_case(tier: Tier, kind: Kind, number: int, seed: int) -> Case:
    """Draw the `number`-th case of its kind; raises Fault where no effect can be as
    strong as required.

    It is drawn again while the cell's preflight refuses to fold it.
    """
    rng = np.random.default_rng(seed)
    triples, place = divmod(number, len(CASE_STRENGTHS))
    bare = Case(
        name=f"{tier}-{seed}-{number:03d}",
        tier=tier,
        kind=kind,
        strip=str(rng.choice(find_configs(None).strip_names())),
        seed=int(rng.integers(2**31)),
        engine="chain" if tier == "state" and number % FOREIGN == 0 else "rod",
        stiffness=float(STIFFER ** rng.uniform(-1, 1)),
        damping=float(SLOWER ** rng.uniform(-1, 1)),
        scatter=SCATTER[(number + triples + triples // BY_HAND_PERIOD) % len(SCATTER)],
        motions="by_hand" if triples % BY_HAND_PERIOD == 1 else "standard",
    )
    level = CASE_STRENGTHS[place]
    for _ in range(TRIES):
        case = _hide(bare, number, level, rng)
        if tier == "state" or kind not in ("single", "pair") or refusal(case) is None:
            return case
    raise Fault(
        "exam", f"{bare.name}: the cell folds no {kind} of {bare.strip} that is {level}"
    )


def _hide(case: Case, number: int, level: Strength, rng: np.random.Generator) -> Case:
    """Hide in `case` what its kind demands: nothing, one effect, two, or a foreign
    cause.
    """
    if case.kind == "single":
        return _with_one(case, number, level, rng)
    if case.kind == "pair":
        return _with_two(case, level, rng)
    return _with_foreign(case, number, rng) if case.kind == "outside" else case


def _with_one(
    case: Case, number: int, level: Strength, rng: np.random.Generator
) -> Case:
    """Hide one effect in `case`; every second round on the chain by a law unlike the
    library's.
    """
    turn, place = divmod(number, FOREIGN * len(CASE_STRENGTHS))
    on_rod = case.tier == "state" and case.engine == "rod"
    if on_rod or turn % UNLIKE_PERIOD == 0:
        return _with_effects(case, level, draw_effects(case, 1, level, rng))
    names = sorted(RESEMBLING)
    first = turn // UNLIKE_PERIOD * len(CASE_STRENGTHS) + place // FOREIGN
    for name in np.roll(names, -first).tolist():
        visible = _visible_effect(case, registry()[name], STRENGTHS[level], rng)
        if visible is not None:
            strip, values = visible
            cause = RESEMBLING[name]
            known = {
                k: v for k, v in values.items() if k in causes()[cause].model_fields
            }
            update = {"strip": strip, "causes": {cause: known}, "answer": (name,)}
            return case.model_copy(update={**update, "strength": level})
    raise Fault("exam", f"{case.name}: no law that resembles the library's is {level}")


def _visible_effect(
    case: Case, effect: Effect, target: float, rng: np.random.Generator
) -> tuple[str, Values] | None:
    """Find a strip on which `effect` leaves the gap `target`, and the effect's values,
    or None.
    """
    others = [str(name) for name in rng.permutation(find_configs(None).strip_names())]
    for strip in [case.strip, *others]:
        for _ in range(PLACE_DRAWS):
            strengths = draw_strengths(effect, find_configs(None).strip(strip), rng)
            gap_model = gap_model_of(case.model_copy(update={"strip": strip}))
            share = gap_model.fraction(strengths, target, JUMP * target)
            if share is not None:
                return strip, strengths.at(share)
    return None


def _with_two(case: Case, level: Strength, rng: np.random.Generator) -> Case:
    """Hide two effects in `case`, each of at least medium strength, alone and beside
    the other.
    """
    strong: Strength = "strong" if level == "strong" else "medium"
    gap_model = gap_model_of(case)
    for _ in range(TRIES):
        both = draw_effects(case, 2, strong, rng)
        if excess_of_each(gap_model, both).min() >= STRENGTHS["medium"] * NEARLY:
            return _with_effects(case, strong, both)
    raise Fault(
        "exam", f"{case.name}: no two effects of {case.strip} show beside each other"
    )


def excess_of_each(gap_model: GapModel, both: dict[str, Values]) -> Array:
    """Excess residual (2,) [noise] of each of two effects, base and other amount
    refitted.

    To first order: the part of the joint response that base and other effect do not
    span.
    """
    alone = [{name: values} for name, values in both.items()]
    joint, *single = gap_model.responses([both, *alone])
    others = [response / np.linalg.norm(response) for response in reversed(single)]
    return np.array(
        [gap_model.excess_of(joint - other * (other @ joint)) for other in others]
    )


def _with_foreign(case: Case, number: int, rng: np.random.Generator) -> Case:
    """Hide a cause that no effect of the library resembles, of medium or strong size,
    in `case`.
    """
    name = str(rng.choice(CAUSE_NAMES))
    strong: Strength = "strong" if number % 2 else "medium"
    hidden = {name: dict(causes()[name].sizes[strong])}
    return case.model_copy(update={"causes": hidden, "strength": strong})


def _with_effects(case: Case, level: Strength, hidden: dict[str, Values]) -> Case:
    update = {"effects": hidden, "answer": tuple(sorted(hidden)), "strength": level}
    return case.model_copy(update=update)


def draw_effects(
    case: Case, count: int, level: Strength, rng: np.random.Generator
) -> dict[str, Values]:
    """Draw `count` effects with their values, each of strength `level` alone on the
    case's plant.

    Raises Fault where no effect of that strip can be that strong.
    """
    strip, gap_model = find_configs(None).strip(case.strip), gap_model_of(case)
    target = STRENGTHS[level]
    effects: dict[str, Values] = {}
    for _ in range(TRIES):
        effect = registry()[str(rng.choice(sorted(registry())))]
        strengths = draw_strengths(effect, strip, rng)
        is_new = effect.name not in effects
        share = gap_model.fraction(strengths, target, JUMP * target) if is_new else None
        if share is not None:
            effects[effect.name] = strengths.at(share)
        if len(effects) == count:
            return dict(sorted(effects.items()))
    raise Fault("exam", f"{case.name}: no effect of {case.strip} is {level}")


def standard_gap_model(
    plant: StripFile, motions: Sequence[str], sigma: Sigma
) -> GapModel:
    """Gap model for the standard motions called `motions`."""
    runs = {run.name: run for run in planned_runs(plant, sigma, 0)}
    return GapModel(plant, [runs[name] for name in motions])


def gap_model_of(case: Case) -> GapModel:
    """Gap model of the case's plant without effects and the case's motions.

    A slip begins at a threshold: on a strip only a little softer than the plant none
    might show.
    """
    hand_seed = case.seed if case.motions == "by_hand" else None
    return _cached_gap_model(
        case.strip, case.stiffness, case.damping, case.tier, hand_seed
    )


@lru_cache(maxsize=2)
def _cached_gap_model(
    name: str, stiffness: float, damping: float, tier: Tier, hand: int | None
) -> GapModel:
    """Make the gap model of the strip called `name` with scaled base parameters;
    cached.
    """
    plant = scale_strip(find_configs(None).strip(name), stiffness, damping)
    if tier == "images":
        return _gap_model_of_cell(plant, hand)
    if hand is None:
        return standard_gap_model(plant, MOTIONS, BENCH)
    return GapModel.along(plant, paths_by_hand(plant.length, hand, len(MOTIONS)), BENCH)


def _gap_model_of_cell(plant: StripFile, hand: int | None) -> GapModel:
    """Gap model of `plant` on the cell's standard motions, or on those by a hand seeded
    `hand`.
    """
    sigma = Sigma.model_validate(find_configs(None).cell().sigma.model_dump())
    order = standard_order(np.random.default_rng(0))
    if hand is None:
        return standard_gap_model(plant, order, sigma)
    led = [
        reported_path(human_motion(plant.length, hand, i)) for i in range(len(order))
    ]
    return GapModel.along(plant, led, sigma)
