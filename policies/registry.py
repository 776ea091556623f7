"""Registry of policies by name: their factories and their appearance in figures.

Names are listed without loading any policy: a factory does its own imports.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from drivers.base.errors import ConfigurationError, check_known
from drivers.base.plugins import guarded, plugins

if TYPE_CHECKING:
    from policies.policy import Policy

    Factory = Callable[[FilePath | None], Policy]

MOTION, BY_HAND = "motion:", "by-hand-"


@dataclass(frozen=True, slots=True)
class PlotStyle:
    """Appearance of a policy in figures: colour, and matplotlib's marker of a `size`
    [points].
    """

    colour: str = "#1b1f24"
    marker: str = "o"
    size: float = 5.5


PLAIN = PlotStyle()


@dataclass(frozen=True, slots=True)
class Entry:
    """Registered policy: the factory `make`, which takes a checkpoint or None, and its
    `rank` in lists.

    A `learned` policy has weights that a checkpoint replaces. `in_rod` is the factory
    for simulated folds, where it differs from that for folds through images.
    """

    rank: int
    make: "Factory"
    learned: bool = False
    in_rod: "Factory | None" = None
    look: PlotStyle = PLAIN


def _path_policy(name: str, _: FilePath | None) -> "Policy":
    """Policy that follows the path `name` of the module `policies.path`."""
    from policies import path
    from policies.follower import PathPolicy

    return PathPolicy(name, getattr(path, name))


def _planned(_: FilePath | None) -> "Policy":
    from policies.planned import Planned

    return Planned()


def _feedback(checkpoint: FilePath | None) -> "Policy":
    from policies.feedback import load_feedback

    return load_feedback(checkpoint)


def _adaptive(checkpoint: FilePath | None, *, in_rod: bool = False) -> "Policy":
    from policies.adaptive.adaptive import Adaptive
    from policies.adaptive.checkpoint import load_bias, load_critic

    return Adaptive(load_critic(checkpoint), None if in_rod else load_bias(checkpoint))


OWN_POLICIES: Mapping[str, Entry] = {
    "triangular": Entry(
        1, partial(_path_policy, "triangular"), look=PlotStyle("#2f6db5", "<")
    ),
    "circular": Entry(
        2, partial(_path_policy, "circular"), look=PlotStyle("#cf6a1f", ">")
    ),
    "shifted": Entry(
        3, partial(_path_policy, "shifted"), look=PlotStyle("#6b7280", "D", size=4.2)
    ),
    "planned": Entry(4, _planned, look=PlotStyle("#8a5fb0", "s", size=4.2)),
    "feedback": Entry(5, _feedback, learned=True, look=PlotStyle("#3a8a5c", size=7.0)),
    "adaptive": Entry(
        6,
        _adaptive,
        learned=True,
        in_rod=partial(_adaptive, in_rod=True),
        look=PlotStyle("#c2352b", "P"),
    ),
}


@cache
def entries() -> Mapping[str, Entry]:
    """All policies by name, those of plug-ins included, in display order."""
    policies = {**OWN_POLICIES, **plugins("policies", Entry, OWN_POLICIES)}
    return dict(sorted(policies.items(), key=lambda item: (item[1].rank, item[0])))


def policy_names() -> tuple[str, ...]:
    """Names of all policies, in display order."""
    return tuple(entries())


def look_of(name: str) -> PlotStyle:
    """Colour and marker of the policy `name` in figures; default ones for an unknown
    name.
    """
    return entries()[name].look if name in entries() else PLAIN


def make_policy(
    name: str, checkpoint: FilePath | None = None, *, in_rod: bool = False
) -> "Policy":
    """Create the policy `name`, for folds through images or, if `in_rod`, for simulated
    folds.

    `checkpoint` replaces the committed weights of a learned policy. Raises
    ConfigurationError for an unknown name, a checkpoint that cannot be read, or one for
    a policy without weights. `motion:NAME` is the standard motion of that name,
    `motion:by-hand-SEED-NUMBER` a random one as a person guides the gripper.
    """
    if name.startswith(MOTION) and checkpoint is None:
        return _standard_motion(name)

    check_known("policy", name, entries())
    if checkpoint is not None and not entries()[name].learned:
        learned = ", ".join(
            sorted(n for n, entry in entries().items() if entry.learned)
        )
        raise ConfigurationError(
            f"checkpoint: {name} has no weights; allowed only for: {learned}"
        )

    entry = entries()[name]
    make = entry.in_rod if in_rod and entry.in_rod is not None else entry.make
    with guarded("policies", name):
        return make(checkpoint)


def _standard_motion(name: str) -> "Policy":
    """Policy that executes the motion `name`: a standard one, or one by hand of a
    seed.
    """
    from policies.experiments.motion import ScriptedPolicy
    from policies.experiments.standard import STANDARD

    motion = name.removeprefix(MOTION)
    by_hand = re.fullmatch(BY_HAND + r"(\d+)-(\d+)", motion)
    if by_hand is not None:
        from policies.experiments.motion import human_motion

        seed, number = map(int, by_hand.groups())
        return ScriptedPolicy(
            name, lambda length, _speed: human_motion(length, seed, number)
        )
    if motion not in STANDARD:
        allowed = ", ".join(MOTION + known for known in STANDARD)
        raise ConfigurationError(
            f"policy: unknown motion {name!r}; allowed: {allowed},"
            f" {MOTION}{BY_HAND}SEED-NUMBER"
        )
    return ScriptedPolicy(name, STANDARD[motion].over)
