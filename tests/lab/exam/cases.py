"""Cases of an exam: drawn at random from its seed, scaled to a strength, and kept as
its key.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from cell.base.campaign import versions
from cell.base.campaign.processes import workers
from cell.base.config.places import find_configs
from cell.gap.effect_size import GapModel, draw_strengths
from cell.gap.subject.strip.synthetic import BENCH, planned_runs, reported_path
from cell.record.header import Sigma
from drivers.base.errors import ConfigurationError, Fault
from drivers.base.files import replace_file, writing
from drivers.base.types import Array
from drivers.strip.effects import registry
from drivers.strip.effects.effect import Effect
from drivers.strip.file import StripFile
from policies.experiments.motion import human_motion
from policies.experiments.standard import (
    REFERENCE_RUN,
    REPEATED_RUN,
    STANDARD,
    standard_order,
)
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

Progress = Callable[[int, int, str], None]
"""Called with the number of cases done, the total, and a text on the last one."""


KEYS_FOLDER = "keys"
SCORER = ("tests/lab/exam/score.py", "tests/lab/exam/run.py")


def quiet(done: int, total: int, text: str) -> None:
    """Progress callback that prints nothing."""


def case_hash(case: Case) -> str:
    """Digest of all fields of a case and of the names of its motions."""
    made = MOTIONS if case.tier == "state" else (*STANDARD, REPEATED_RUN, REFERENCE_RUN)
    return hashlib.sha256(
        (case.model_dump_json() + " ".join(made)).encode()
    ).hexdigest()[:16]


@dataclass(frozen=True, slots=True)
class Sources:
    """Digests of the source code that makes verdicts (`engine`) and that scores them
    (`scorer`).
    """

    engine: str
    scorer: str

    def verdict(self, case: Case) -> str:
        """Digest of everything that the verdict on `case` depends on."""
        return f"{self.engine}-{case_hash(case)}"

    def entry(self, case: Case) -> str:
        """Digest of everything that the ledger entry of `case` depends on."""
        return f"{self.verdict(case)}-{self.scorer}"


def sources() -> Sources:
    """Digests of the source files as they are on disk now."""
    return Sources(engine=versions.verdicts(), scorer=versions.sources(SCORER))


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
SHARES: dict[Tier, dict[Kind, float]] = {
    "state": {"nothing": 0.43, "single": 0.47, "pair": 0.10},
    "images": {"nothing": 0.25, "single": 0.40, "pair": 0.15, "outside": 0.20},
}
# one in so many triples of levels in a chain has laws that only resemble
UNLIKE_PERIOD = 2
CAUSE_NAMES = sorted(name for name, cause in causes().items() if cause.sizes)
RESEMBLING = {cause.answers: name for name, cause in causes().items() if cause.answers}


@dataclass(frozen=True, slots=True)
class Draw:
    """Request to draw case `i` of the exam with `seed`, the `number`-th case of its
    kind.
    """

    tier: Tier
    kind: Kind
    i: int
    number: int
    seed: int

    def case(self) -> Case:
        """Draw the case; raises Fault where no effect can be as strong as required."""
        drawn = _case(self.tier, self.kind, self.i, self.number, self.seed)
        return drawn.model_copy(update={"scatter": _scatter_level(self.number)})


def cases(
    tier: Tier,
    count: int,
    seed: int,
    only: Kind | None = None,
    progress: Progress = quiet,
    jobs: int = 1,
) -> list[Case]:
    """Draw `count` cases in `jobs` processes; equal seeds give equal cases.

    All are of the kind `only`, or of every kind in the tier's shares. `progress` is
    called after each tenth. Raises Fault where no effect can be as strong as required.
    """
    kinds = [only] * count if only else _kinds(tier, count)
    draws = [
        Draw(tier, kind, i, kinds[:i].count(kind), seed) for i, kind in enumerate(kinds)
    ]
    found: dict[int, Case] = {}
    with workers(jobs) as calls:
        for number, case in calls(Draw.case, [(draw,) for draw in draws]):
            found[number] = case
            if len(found) * 10 // count > (len(found) - 1) * 10 // count:
                progress(len(found), count, "cases drawn")
    return [found[number] for number in range(count)]


def _scatter_level(number: int) -> ScatterLevel:
    """Run-to-run scatter of case `number` of a kind; cycles over strengths and motions
    as well.
    """
    levels, triples = len(SCATTER), number // len(CASE_STRENGTHS)
    return SCATTER[(number + triples + triples // BY_HAND_PERIOD) % levels]


def _kinds(tier: Tier, count: int) -> list[Kind]:
    """Kinds of `count` cases in the tier's shares, rounded by largest remainders."""
    exact = {kind: share * count for kind, share in SHARES[tier].items()}
    whole = {kind: int(number) for kind, number in exact.items()}
    by_remainder = sorted(exact, key=lambda kind: whole[kind] - exact[kind])
    for kind in by_remainder[: count - sum(whole.values())]:
        whole[kind] += 1
    return [kind for kind, number in whole.items() for _ in range(number)]


def _case(tier: Tier, kind: Kind, i: int, number: int, seed: int) -> Case:
    """Draw a case of `kind`; repeats the draw while the cell's preflight refuses to
    fold it.
    """
    rng = np.random.default_rng([seed, i])
    bare = Case(
        name=f"{tier}-{seed}-{i:03d}",
        tier=tier,
        kind=kind,
        strip=str(rng.choice(find_configs(None).strip_names())),
        seed=int(rng.integers(2**31)),
        engine="chain" if tier == "state" and i % FOREIGN == 0 else "rod",
        stiffness=float(STIFFER ** rng.uniform(-1, 1)),
        damping=float(SLOWER ** rng.uniform(-1, 1)),
        motions="by_hand"
        if i // len(CASE_STRENGTHS) % BY_HAND_PERIOD == 1
        else "standard",
    )
    level = CASE_STRENGTHS[number % len(CASE_STRENGTHS)]
    for _ in range(TRIES):
        case = _hide(bare, number, level, seed, rng)
        if tier == "state" or kind not in ("single", "pair") or refusal(case) is None:
            return case
    raise Fault(
        "exam", f"{bare.name}: the cell folds no {kind} of {bare.strip} that is {level}"
    )


def _hide(
    case: Case, number: int, level: Strength, seed: int, rng: np.random.Generator
) -> Case:
    """Hide in `case` what its kind demands: nothing, one effect, two, or a foreign
    cause.
    """
    if case.kind == "single":
        return _with_one(case, number, level, rng)
    if case.kind == "pair":
        return _with_two(case, level, rng)
    return _with_foreign(case, number, seed) if case.kind == "outside" else case


def _with_one(
    case: Case, number: int, level: Strength, rng: np.random.Generator
) -> Case:
    """Hide one effect in `case`; every second round on the chain by a law unlike the
    library's.
    """
    turn, place = divmod(number, len(CASE_STRENGTHS))
    on_rod = case.tier == "state" and case.engine == "rod"
    if on_rod or turn % UNLIKE_PERIOD == 0:
        return _with_effects(case, level, draw_effects(case, 1, level, rng))
    names = sorted(RESEMBLING)
    first = (turn // UNLIKE_PERIOD * len(CASE_STRENGTHS) + place) % len(names)
    for name in [*names[first:], *names[:first]]:
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


def _with_foreign(case: Case, number: int, seed: int) -> Case:
    """Hide a cause that no effect of the library resembles, of medium or strong size,
    in `case`.

    The order of the causes depends on the exam's `seed`.
    """
    turn, place = divmod(number, len(CAUSE_NAMES))
    name = str(np.random.default_rng(seed).permutation(CAUSE_NAMES)[place])
    strong: Strength = "strong" if (turn + place) % 2 else "medium"
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


DRAWN_FILE = "drawn.json"
CASE_COUNTS = {"state": 300, "images": 90, "small": 6}


def load_or_draw(
    folder: Path,
    tier: str,
    count: int | None,
    seed: int,
    repeats: int = 1,
    kind: Kind | None = None,
    force: float | None = None,
    progress: Progress = quiet,
    jobs: int = 1,
) -> tuple[Case, ...]:
    """Load the cases stored in `folder` for the same request, or draw them in `jobs`
    processes.

    From the state each motion is made `repeats` times; with a `kind` all cases are of
    that kind; with a `force` [N] the arm reports the strip's force with that noise, all
    else being equal. Raises ConfigurationError where the folder holds another exam or
    cannot be written, for repeats through images and for causes outside the library
    without images.
    """
    if repeats > 1 and tier == "images":
        raise ConfigurationError("--repeats: is for exams from the state; leave it out")
    if kind == "outside" and tier != "images":
        raise ConfigurationError(
            "--kind outside: is for exams through images; add --tier images"
        )
    path = folder / KEYS_FOLDER / DRAWN_FILE
    wanted = count or CASE_COUNTS[tier]
    options = {
        "repeats": repeats if repeats > 1 else None,
        "kind": kind,
        "force": force,
    }
    asked: dict[str, object] = {"tier": tier, "count": wanted, "seed": seed}
    asked |= {option: value for option, value in options.items() if value}
    known = _read(path)
    if known is None:
        of: Tier = "images" if tier == "images" else "state"
        drawn = cases(of, wanted, seed, kind, progress, jobs)
        found = tuple(
            c.model_copy(update={"repeats": repeats, "force": force}) for c in drawn
        )
        _keep(
            path, {**asked, "cases": [case.model_dump(mode="json") for case in found]}
        )
        return found
    held = {key: known.get(key) for key in asked}
    if held != asked:
        given = " ".join(f"{key} {value}" for key, value in held.items())
        raise ConfigurationError(
            f"--out: {folder} holds another exam ({given}); name a new folder"
        )
    return _cases(path, known)


def _read(path: Path) -> dict[str, object] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            f"{path}: cannot be read: {error}; remove the folder"
        ) from None
    return content if isinstance(content, dict) else {}


def _cases(path: Path, known: dict[str, object]) -> tuple[Case, ...]:
    held = known.get("cases")
    try:
        return tuple(
            Case.model_validate(c) for c in (held if isinstance(held, list) else [])
        )
    except ValidationError:
        raise ConfigurationError(
            f"{path}: was drawn by another version; name a new folder"
        ) from None


def _keep(path: Path, content: dict[str, object]) -> None:
    with writing(f"--out: {path}"):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        replace_file(path, json.dumps(content, indent=1).encode())
    path.chmod(0o600)
