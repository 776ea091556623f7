"""Policies by name."""

from pathlib import Path as FilePath

from drivers.errors import ConfigurationError
from policies.catalogue import entries
from policies.policy import Policy

MOTION = "motion:"


def policy_names() -> tuple[str, ...]:
    """The names that `make_policy` accepts, in display order."""
    return tuple(entries())


def make_policy(name: str, checkpoint: FilePath | None = None, *, in_rod: bool = False) -> Policy:
    """The policy called `name`, not yet reset, for folds through images or `in_rod`.

    `checkpoint` replaces the committed weights of a learned policy. Raises ConfigurationError
    for an unknown name, a checkpoint that cannot be read, or one for a policy without weights.
    `motion:NAME` is the standard motion of that name.
    """
    if name.startswith(MOTION) and checkpoint is None:
        return _motion(name)
    if name not in entries():
        raise ConfigurationError(f"policy: unknown name {name!r}; allowed: {', '.join(entries())}")
    if checkpoint is not None and not entries()[name].learned:
        learned = ", ".join(sorted(n for n, entry in entries().items() if entry.learned))
        raise ConfigurationError(f"checkpoint: {name} has no weights; allowed only for: {learned}")
    entry = entries()[name]
    make = entry.in_rod if in_rod and entry.in_rod is not None else entry.make
    return make(checkpoint)


def _motion(name: str) -> Policy:
    from policies.scripted import Scripted
    from policies.standard import STANDARD

    standard = STANDARD.get(name.removeprefix(MOTION))
    if standard is None:
        allowed = ", ".join(MOTION + known for known in STANDARD)
        raise ConfigurationError(f"policy: unknown motion {name!r}; allowed: {allowed}")
    return Scripted(name, standard.of)
