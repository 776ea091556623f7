"""Study of `adaptive` on unmeasured strips, each effect hidden in turn, from noisy
states.
"""

import numpy as np

from cell.studies.evaluation import stepper
from drivers.strip.describe import describe
from drivers.strip.file import StripFile
from policies.adaptive.checkpoint import load_critic
from policies.adaptive.train.shard import true_belief
from policies.policy import Estimate, FoldPrediction, Policy
from policies.registry import make_policy
from policies.rollout import Folds, Rollout, roll_out
from policies.strip_sampling import EFFECTS, STRIP_LENGTH, draw_effect, plain_strip
from tests.lab.studies.kit.folds import SIGMAS_95
from tests.lab.studies.kit.rollouts import Kept, rough, sensing_of, stretchy
from tests.lab.studies.study import Quantity, Statistic, Study, Values, percentage

STRANGE = {
    "friction 20-60": rough(20.0, 60.0),
    "friction 90": rough(90.0, 90.1),
    "stretch 3 N": stretchy,
}
SUBSTEP_RATE = 180.0  # Hz, of the engine's steps at every rate of images
ROLLS = 20  # draws of every condition on the rod
SENSED = (
    "nothing",
    "30 Hz",
    "3 mm noise",
    "half dropped",
    "latency +-10 ms",
    "latency +-30 ms",
)
CONDITIONS = (*SENSED, *STRANGE, *EFFECTS)


def draw(number: int, rng: np.random.Generator) -> Values:
    """Draw a strip in the next condition, each ROLLS times for the rod, then for the
    chain.
    """
    times, which = divmod(number, len(CONDITIONS))
    name = CONDITIONS[which]
    if name in STRANGE:
        strip = STRANGE[name](rng)
    else:
        effects = {name: draw_effect(name, rng)} if name in EFFECTS else {}
        strip = plain_strip(rng, STRIP_LENGTH, **effects)
    content = strip.model_dump(mode="json", by_alias=True)
    engine = "chain" if times >= ROLLS else "rod"
    return {"engine": engine, "condition": name, "strip": content, "noise": number}


def measure(case: Values) -> Values:
    """Displacements [m] by `adaptive` and by the shifted triangle, and errors of its
    estimates.
    """
    strip = StripFile.model_validate(case["strip"])
    rate = 30.0 if case["condition"] == "30 Hz" else 60.0
    sensing = sensing_of(case["condition"])
    settings = Rollout(rate=rate, sensing=sensing, substeps=round(SUBSTEP_RATE / rate))
    rng, policy = np.random.default_rng([case["noise"], 1]), Kept(load_critic())

    def fold(by: Policy) -> Folds:
        engine, lying = stepper(case["engine"]), [describe(strip)]
        return roll_out(by, engine, strip, lying, settings=settings, rng=rng)

    first = fold(policy)
    known = _last_prediction(policy, first)
    shifted, second = fold(make_policy("shifted")), fold(policy)
    again = _last_prediction(policy, second)
    d = float(first.displacement[0])
    length, time, _ = true_belief(strip)
    ratio = abs(d - known.displacement) / known.sigma
    both, sigma = _combine(known.retardation_time, again.retardation_time)
    return {
        "d": d,
        "shifted": float(shifted.displacement[0]),
        "touched": first.touch[0] is not None,
        "within_1": ratio < 1.0,
        "within_2": ratio < SIGMAS_95,
        "length_off": float(np.log(known.bending_length.value) - length),
        "time_off": float(np.log(known.retardation_time.value) - time),
        "time_off_both": both - time,
        "time_within": _contains(known.retardation_time, time),
        "time_within_both": abs(both - time) < sigma,
    }


def _last_prediction(policy: Kept, folds: Folds) -> FoldPrediction:
    """Last prediction of `policy` before the touch."""
    touch = folds.touch[0]
    end = np.inf if touch is None else touch.time
    return [said for seen, said in policy.seen if seen.time[0] < end][-1]


def _combine(a: Estimate, b: Estimate) -> tuple[float, float]:
    """Mean and sigma of the product of two estimates of a logarithm, taken as
    independent.
    """
    means = np.log([a.value, b.value])
    weights = np.log([a.high / a.low, b.high / b.low]) ** -2.0
    return float(means @ weights / weights.sum()), 0.5 / float(np.sqrt(weights.sum()))


def _contains(estimate: Estimate, log: float) -> bool:
    return estimate.low < float(np.exp(log)) < estimate.high


STUDY = Study(
    name="adaptive",
    question=(
        "How far off is `adaptive` from noisy states, with each effect hidden in turn?"
    ),
    draw=draw,
    measure=measure,
    by=("engine", "condition"),
    quantities=(
        Quantity("d", Statistic.MEAN_SIZE, label="mean |d|"),
        Quantity("d", Statistic.P95_SIZE, label="95 % |d|"),
        Quantity("d", Statistic.WORST_SIZE, label="worst |d|"),
        Quantity("shifted", Statistic.MEAN_SIZE, label="mean |d|, shifted"),
        percentage("touched", "touched"),
        percentage("within_1", "within 1 sigma"),
        percentage("within_2", "within 1.96"),
        Quantity("length_off", Statistic.RMS, "%", 100.0, label="length off", digits=1),
        Quantity("time_off", Statistic.RMS, "%", 100.0, label="time off", digits=0),
        Quantity(
            "time_off_both", Statistic.RMS, "%", 100.0, label="by two folds", digits=0
        ),
        percentage("time_within", "time within sigma"),
        percentage("time_within_both", "by two folds"),
    ),
    usual=ROLLS * len(CONDITIONS),
    quick=1,
    seconds=1.5,
)
