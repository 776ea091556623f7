"""Policies by name: their factories and their appearance in figures."""

import re
from pathlib import Path as FilePath

from drivers.errors import ConfigurationError, suggestion
from policies.catalogue import entries
from policies.catalogue.entry import Look
from policies.policy import Policy

MOTION, BY_HAND = "motion:", "by-hand-"


def policy_names() -> tuple[str, ...]:
    """The names that `make_policy` accepts, in display order."""
    return tuple(entries())


def look_of(name: str) -> Look:
    """Colour and marker of a policy in figures; plain ones for an unknown name."""
    return entries()[name].look if name in entries() else Look()


def make_policy(name: str, checkpoint: FilePath | None = None, *, in_rod: bool = False) -> Policy:
    """The policy called `name`, not yet reset, for folds through images or `in_rod`.

    `checkpoint` replaces the committed weights of a learned policy. Raises ConfigurationError
    for an unknown name, a checkpoint that cannot be read, or one for a policy without weights.
    `motion:NAME` is the standard motion of that name, `motion:by-hand-SEED-NUMBER` one as a person
    leads the gripper, drawn from these numbers.
    """
    if name.startswith(MOTION) and checkpoint is None:
        return _standard_motion(name)
    if name not in entries():
        raise ConfigurationError(
            f"policy: unknown name {name!r}{suggestion(name, entries())}; "
            f"allowed: {', '.join(entries())}"
        )
    if checkpoint is not None and not entries()[name].learned:
        learned = ", ".join(sorted(n for n, entry in entries().items() if entry.learned))
        raise ConfigurationError(f"checkpoint: {name} has no weights; allowed only for: {learned}")
    entry = entries()[name]
    make = entry.in_rod if in_rod and entry.in_rod is not None else entry.make
    return make(checkpoint)


def _standard_motion(name: str) -> Policy:
    """Policy that executes the motion `name`: a standard one, or by hand of a seed and number."""
    from policies.experiments.scripted import Scripted
    from policies.experiments.standard import STANDARD

    wanted = name.removeprefix(MOTION)
    led = re.fullmatch(BY_HAND + r"(\d+)-(\d+)", wanted)
    if led is not None:
        from policies.experiments.by_hand import by_hand

        seed, number = map(int, led.groups())
        return Scripted(name, lambda length, _speed: by_hand(length, seed, number))
    if wanted not in STANDARD:
        allowed = ", ".join(MOTION + known for known in STANDARD)
        raise ConfigurationError(
            f"policy: unknown motion {name!r}; allowed: {allowed}, {MOTION}{BY_HAND}SEED-NUMBER"
        )
    return Scripted(name, STANDARD[wanted].of)
