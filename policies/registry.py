"""Policies by name."""

from collections.abc import Callable
from pathlib import Path as FilePath

from drivers.errors import ConfigurationError
from policies.policy import Policy

MOTION = "motion:"


def policy_names() -> tuple[str, ...]:
    """The names that `make_policy` knows, in the order in which to show them."""
    return tuple(_MAKERS)


def make_policy(name: str, checkpoint: FilePath | None = None) -> Policy:
    """The policy called `name`, not yet reset.

    `checkpoint` replaces the committed weights of a learned policy. Raises ConfigurationError
    for an unknown name, a checkpoint that cannot be read, or one for a policy without weights.
    `motion:NAME` is the standard motion of that name.
    """
    if name.startswith(MOTION) and checkpoint is None:
        return _motion(name)
    if name not in _MAKERS:
        raise ConfigurationError(f"policy: unknown name {name!r}; allowed: {', '.join(_MAKERS)}")
    if checkpoint is not None and name not in _LEARNED:
        raise ConfigurationError(
            f"checkpoint: {name} has no weights; allowed only for: {', '.join(sorted(_LEARNED))}"
        )
    return _MAKERS[name](checkpoint)


def _motion(name: str) -> Policy:
    from policies.scripted import Scripted
    from policies.standard import STANDARD

    standard = STANDARD.get(name.removeprefix(MOTION))
    if standard is None:
        allowed = ", ".join(MOTION + known for known in STANDARD)
        raise ConfigurationError(f"policy: unknown motion {name!r}; allowed: {allowed}")
    return Scripted(name, standard.of)


def _triangular(_: FilePath | None) -> Policy:
    from policies.fixed_paths import Triangular

    return Triangular()


def _circular(_: FilePath | None) -> Policy:
    from policies.fixed_paths import Circular

    return Circular()


def _shifted(_: FilePath | None) -> Policy:
    from policies.fixed_paths import Shifted

    return Shifted()


def _planned(_: FilePath | None) -> Policy:
    from policies.planned import Planned

    return Planned()


def _feedback(checkpoint: FilePath | None) -> Policy:
    from policies.feedback import load_feedback

    return load_feedback(checkpoint)


_LEARNED = frozenset({"feedback"})
_MAKERS: dict[str, Callable[[FilePath | None], Policy]] = {
    "triangular": _triangular,
    "circular": _circular,
    "shifted": _shifted,
    "planned": _planned,
    "feedback": _feedback,
}
