"""Study of perception against the truth: contact, tip, profile, touch, over folds of
the chain.

What policies are trained with beside it is written into `policies/sensing.yaml`, what
errs alike in all runs into `cell/gap/subject/strip/bias.yaml`; sigma in
`configs/cell.yaml` and the contact bias of `cell.perception.perception` are read off
this table.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cell.base.config.places import find_configs
from drivers.base.geometry import robust_sigma
from drivers.base.types import Array
from drivers.strip.shape import fold_tip
from policies.experiments.standard import REFERENCE_RUN, STANDARD
from policies.path import triangular
from policies.profile import image_profile, profiles
from tests.lab.studies.kit.sights import Sight, fold_of, sights
from tests.lab.studies.study import Fit, Outcome, Quantity, Statistic, Study, Values

SPEED, IMAGE_STRIDE = 0.1, 3  # m/s; images
LINKS = 80  # of the chain that is folded
ERRORS = ("contact", "tip_x", "tip_z", "curve", "profile")
OUTLIER = 5.0  # robust standard deviations from which an error is an outlier


def draw(number: int, _rng: np.random.Generator) -> Values:
    """Draw case `number`; cases go through strips on a triangle, then on a standard
    motion.
    """
    strips = find_configs(None).strip_names()
    return {
        "strip": strips[number % len(strips)],
        "standard": number // len(strips) % 2 == 1,
    }


def measure(case: Values) -> Values:
    """Errors of each image of a fold, seen minus true [m, s]."""
    strip = find_configs(None).strip(case["strip"])
    path = (STANDARD[REFERENCE_RUN].shape if case["standard"] else triangular)(
        strip.length
    )
    fold = fold_of(case["strip"], path, SPEED, LINKS)
    images = list(sights(fold, IMAGE_STRIDE))
    seen = [
        s for s in images if len(s.seen.profile) >= 2 and np.isfinite(s.seen.contact_x)
    ]
    errors: dict[str, list[float]] = {name: [] for name in ERRORS}
    halves: dict[str, list[float]] = defaultdict(list)
    curves = [_profile_errors(sight) for sight in seen]
    for sight, curve in zip(seen, curves, strict=True):
        tip = sight.seen.tip - np.array(fold_tip(fold.shape(sight.stamp)))
        row = (sight.contact, *tip, _rms(curve), _rms(sight.profile()[0]))
        for name, value in zip(ERRORS, row, strict=True):
            errors[name].append(float(value))
        _add_errors(halves, sight, strip.length)
    contact, (late, displacement) = np.array(errors["contact"]), _touch_errors(images)
    return {
        **errors,
        "bias": float(np.median(contact)),
        "noise": spread(contact),
        "tip_bias": [float(np.median(errors[name])) for name in ("tip_x", "tip_z")],
        "tip_noise": [spread(np.array(errors[name])) for name in ("tip_x", "tip_z")],
        "halves": {
            name: float(np.mean(values)) for name, values in sorted(halves.items())
        },
        "curve_bias": _rms(np.mean(curves, axis=0)),
        "curve_noise": spread(np.diff(curves, axis=0).ravel()) / np.sqrt(2.0),
        "wild": float(
            np.mean(abs(contact - np.median(contact)) > OUTLIER * spread(contact))
        ),
        "unseen": (len(images) - len(seen)) / len(images),
        "late": late,
        "displacement": displacement,
    }


def _touch_errors(images: Sequence[Sight]) -> tuple[float, float] | tuple[None, None]:
    """Errors of the touch in time [s] and displacement [m]; None where it was
    missed.
    """
    seen, true = images[-1].touch, images[-1].fold.touch
    if seen is None or true is None:
        return None, None
    return seen.time - true.time, seen.displacement - true.displacement


def _add_errors(halves: dict[str, list[float]], sight: Sight, length: float) -> None:
    """Add the errors of an image in contact and thirds of the profile to its half of
    the run.
    """
    side = "past" if sight.pose.x < length / 2 else "before"
    halves[f"contact {side}"].append(sight.contact)
    off, where = sight.profile()
    third = np.minimum((3 * where).astype(int), 2)
    for k in np.unique(third):
        halves[f"profile {k} {side}"].append(float(np.median(off[third == k])))


def _profile_errors(sight: Sight) -> Array:
    """Errors (points, 2) [m] of the profile as a policy reads it."""
    fold, grip = sight.fold, (sight.pose.x, sight.pose.z)
    seen = image_profile(sight.seen.profile, sight.seen.contact_x, grip)[0]
    contact, true = (
        np.array([fold.contact_x(sight.stamp)]),
        fold.shape(sight.stamp)[None],
    )
    straight = profiles(true, fold.arc[None], contact, np.array([grip]))
    return np.asarray((seen - straight[0])[1:-1])


def noise_of_images(outcomes: Sequence[Outcome]) -> Values:
    """Noise of images, medians over strips, and their biases, root mean squares over
    strips.
    """
    rows = [o.values for o in outcomes]
    noise = np.median(
        [[row["noise"], *row["tip_noise"], row["curve_noise"]] for row in rows], 0
    )
    names = ("contact_sigma", "tip_sigma", "tip_z_sigma", "profile_sigma")
    return {
        "schema": 1,
        **dict(zip(names, map(float, noise), strict=True)),
        "contact_bias": _rms([row["bias"] for row in rows]),
        "tip_bias": _rms([row["tip_bias"][0] for row in rows]),
        "profile_bias": _rms([row["curve_bias"] for row in rows]),
        "wild": float(np.mean([row["wild"] for row in rows])),
        "strips": len(rows),
    }


def bias(outcomes: Sequence[Outcome]) -> Values:
    """Systematic errors of images in half a run, as root mean squares for the gap
    workflow.

    `edge` is that of the profile beside the near edge, on the other side past the
    middle. l1 and l2 err alike, so that the place of a touch errs by half as much as
    the displacement.
    """
    rows = [o.values for o in outcomes]
    means = [(k, v) for row in rows for k, v in row["halves"].items()]
    contact = [v for k, v in means if k.startswith("contact")]
    towards = [
        v if k.endswith("past") else -v for k, v in means if k.startswith("profile")
    ]
    edge = float(np.mean(towards))
    d = _rms([row["displacement"] for row in rows if row["displacement"] is not None])
    return {
        "schema": 1,
        "edge": edge,
        "profile": _rms(np.subtract(towards, edge)),
        "contact_x": _rms(contact),
        "displacement": d,
        "touch_x": d / 2,
        "touch_time": _rms([row["late"] for row in rows if row["late"] is not None]),
        "strips": len(rows),
    }


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def spread(values: Array) -> float:
    """Robust standard deviation of values (n,)."""
    return robust_sigma(values - np.median(values))


STUDY = Study(
    name="perception",
    question="How well do images agree with the truth?",
    draw=draw,
    measure=measure,
    by=("strip",),
    quantities=(
        Quantity("contact", Statistic.RMS, label="contact rms", bar=1.5),
        Quantity("contact", Statistic.WORST_SIZE, label="contact worst"),
        Quantity("bias", Statistic.MEAN, label="contact bias"),
        Quantity("noise", Statistic.MEDIAN, label="contact noise"),
        Quantity("wild", Statistic.MEAN, "%", 100.0, label="wild", digits=1),
        Quantity("tip_x", Statistic.RMS, label="tip x rms"),
        Quantity("tip_z", Statistic.RMS, label="tip z rms"),
        Quantity("profile", Statistic.RMS, label="profile rms", bar=1.0),
        Quantity("curve", Statistic.RMS, label="policy's profile rms"),
        Quantity("unseen", Statistic.MEAN, "%", 100.0, label="unseen", digits=1),
        Quantity("late", Statistic.WORST_SIZE, "ms", label="touch late", digits=0),
        Quantity("displacement", Statistic.WORST_SIZE, label="d off"),
    ),
    fits=(
        Fit("policies/sensing.yaml", noise_of_images),
        Fit("cell/gap/subject/strip/bias.yaml", bias),
    ),
    usual=20,
    quick=1,
    seconds=15.0,
)
