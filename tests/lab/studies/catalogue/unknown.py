"""Study of unmeasured strips, drawn over the paper's range, folded by `adaptive`
through images.

A cell that knows only their length folds them, with calipers also their thickness.
"""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.optimize import least_squares

from cell.record.run import read_run
from drivers.base.types import Array
from drivers.strip.file import StripFile
from policies.adaptive.critic import Untrained
from policies.adaptive.train.shard import true_belief
from policies.adaptive.train.transfer import COVERAGE
from policies.strip_sampling import (
    EFFECTS,
    STRIP_LENGTH,
    draw_effect,
    draw_friction,
    plain_strip,
)
from tests.lab.studies.kit.folds import (
    QUANTITIES,
    SIGMAS_95,
    cell_with_twin,
    compare,
    fold_unknown,
)
from tests.lab.studies.study import (
    Fit,
    Outcome,
    Quantity,
    Statistic,
    Study,
    Values,
    percentage,
)

FRICTION_RANGE = (20.0, 60.0)  # 1/m
DISPLACEMENT_SCALE = 1e-3  # m
CROSS_FOLDS = 5  # of the cross-validation
TRAINED, UNFLAGGED_SHARE = ("nothing", "friction", "seam"), 0.99
EFFECT_PAIRS = ("friction+seam", "seam+stretch", "friction+hem_mass")
CONDITIONS = (
    *(
        ("calipers", hidden)
        for hidden in ("nothing", "friction", *EFFECTS, *EFFECT_PAIRS)
    ),
    *(
        (known, hidden)
        for known in ("length alone", "half dropped")
        for hidden in ("nothing", "friction")
    ),
)


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw a strip in the next condition: what the cell knows or loses, and the hidden
    effect.
    """
    known, hidden = CONDITIONS[number % len(CONDITIONS)]
    effects = {}
    for part in hidden.split("+"):
        if part == "friction":
            effects["bending_hysteresis"] = draw_friction(rng, *FRICTION_RANGE)
        elif part != "nothing":
            effects[part] = draw_effect(part, rng)
    strip = plain_strip(rng, STRIP_LENGTH, **effects)
    content = strip.model_dump(mode="json", by_alias=True)
    return {"known": known, "hidden": hidden, "strip": content, "noise": number}


def measure(case: Values) -> Values:
    """Facts of the fold, and the errors of `adaptive`'s estimate of the strip."""
    strip = StripFile.model_validate(case["strip"])
    with TemporaryDirectory() as name:
        place = Path(name)
        lost = 0.5 if case["known"] == "half dropped" else 0.0
        result = fold_unknown(
            strip,
            case["noise"],
            place,
            measured=case["known"] != "length alone",
            cell=cell_with_twin(camera={"lost": lost}),
        )
        found = dict(compare(result)) | {"untrained": Untrained.shipped().added}
        found |= _loop_size(Path(result.run), strip.length, result.edge_offset_true)
        found |= _held(Path(result.run), strip)
    length, time, _ = true_belief(strip)
    if "believed_length" in found:
        found |= {
            "length_off": found["believed_length"] - length,
            "time_off": found["believed_time"] - time,
        }
    return found


def _held(run: Path, strip: StripFile) -> Values:
    """Whether the intervals of the policy's rods hold the strip's own parameters."""
    stored = read_run(run).result
    told = None if stored is None else stored.foretold
    if told is None:
        return {}
    friction = strip.effects.get("bending_hysteresis", {}).get("yield_curvature", 0.0)
    known = {
        "length_held": (told.bending_length, strip.bending_length),
        "time_held": (told.retardation_time, strip.retardation_time),
        "friction_held": (told.yield_curvature, friction),
    }
    return {name: span.low <= true <= span.high for name, (span, true) in known.items()}


def _loop_size(run: Path, length: float, edges: float | None) -> Values:
    """Height and width [m] of the laid fold's loop, and the extra length [m] that it
    holds.
    """
    seen = [
        e.facts.get("loop") for e in read_run(run).events() if e.kind == "edges_seen"
    ]
    if edges is None or not seen or not isinstance(loop := seen[0], dict):
        return {}
    held = edges - (length - 2.0 * loop["tip_x"])
    return {"height": loop["height"], "width": loop["width"], "held": held}


def laid_weights(outcomes: Sequence[Outcome]) -> Values:
    """Linear model of the loop's extra length, and its cross-validated rms error
    [m].
    """
    kept = [
        o
        for o in outcomes
        if "held" in o.values and o.case.values["known"] == "calipers"
    ]
    thickness = [o.case.values["strip"]["thickness"] for o in kept]
    size = [(1.0, o.values["height"], o.values["width"]) for o in kept]
    terms, held = (
        np.column_stack([size, thickness]),
        np.array([o.values["held"] for o in kept]),
    )
    fold = np.arange(len(kept)) % CROSS_FOLDS
    errors = [
        held[fold == k]
        - terms[fold == k] @ _robust_fit(terms[fold != k], held[fold != k])
        for k in range(CROSS_FOLDS)
    ]
    names = ("constant", "height", "width", "thickness")
    rms = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    return {
        "schema": 1,
        **dict(zip(names, _robust_fit(terms, held).tolist(), strict=True)),
        "rms": rms,
        "folds": len(kept),
    }


def untrained_sigma(outcomes: Sequence[Outcome]) -> Values:
    """Addition to the critic's sigma [m] with which 68 % of all displacements are
    within one.
    """
    known = [o.values for o in outcomes if "surprise" in o.values]
    surprise = np.array([values["surprise"] for values in known])
    used = [values.get("untrained", 0.0) for values in known]
    trained = np.square([values["sigma"] for values in known]) - np.square(used)
    added = float(
        np.quantile(np.sqrt(np.maximum(surprise**2 - trained, 0.0)), COVERAGE)
    )
    ratio = np.abs(surprise) / np.sqrt(trained + added**2)
    within = [float(np.mean(ratio < sigmas)) for sigmas in (1.0, SIGMAS_95)]
    return {
        "schema": 1,
        "added": added,
        "within_1": within[0],
        "within_2": within[1],
        "folds": len(known),
    }


def model_limits(outcomes: Sequence[Outcome]) -> Values:
    """Limits of residual [m] and curvature [1/m] that UNFLAGGED_SHARE of the folds keep
    which hide nothing but what the policy was trained with.
    """
    rows = [
        o.values
        for o in outcomes
        if o.case.values["hidden"] in TRAINED and o.values["residual"] is not None
    ]
    found = {
        name: float(np.quantile([row[name] for row in rows], UNFLAGGED_SHARE))
        for name in ("residual", "yield_curvature")
    }
    return {"schema": 1, **found, "share": UNFLAGGED_SHARE, "folds": len(rows)}


def _robust_fit(terms: Array, values: Array) -> Array:
    """Fit `values` (n,) [m] by `terms` (n, k) with Cauchy's loss beyond
    DISPLACEMENT_SCALE.
    """
    found = np.linalg.lstsq(terms, values, rcond=None)[0]
    fit = least_squares(
        lambda x: (terms @ x - values) / DISPLACEMENT_SCALE,
        found,
        loss="cauchy",
        x_scale="jac",
    )
    return np.asarray(fit.x)


STUDY = Study(
    name="unknown",
    question=(
        "How far off does `adaptive` fold strips that nobody measured, and does it"
        " say so?"
    ),
    draw=draw,
    measure=measure,
    by=("known", "hidden"),
    quantities=(
        *QUANTITIES,
        Quantity("length_off", Statistic.RMS, "%", 100.0, label="length off", digits=1),
        Quantity("time_off", Statistic.RMS, "%", 100.0, label="time off", digits=0),
        *(
            percentage(f"{name}_held", f"{name} held")
            for name in ("length", "time", "friction")
        ),
    ),
    fits=(
        Fit("cell/perception/laid_fold.yaml", laid_weights),
        Fit("policies/adaptive/untrained.yaml", untrained_sigma),
        Fit("cell/perception/model_agreement.yaml", model_limits),
    ),
    usual=10 * len(CONDITIONS),
    quick=1,
    seconds=10.0,
)
