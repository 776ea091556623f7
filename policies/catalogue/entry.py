"""Entry of a policy in the registry."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from policies.policy import Policy


@dataclass(frozen=True, slots=True)
class Look:
    """Appearance of a policy in figures: colour, and matplotlib's marker of a `size` [points]."""

    colour: str = "#1b1f24"
    marker: str = "o"
    size: float = 5.5


PLAIN = Look()


@dataclass(frozen=True, slots=True)
class Entry:
    """A policy's factory, called with a checkpoint or None, and its `rank` in lists.

    A `learned` policy has weights that a checkpoint replaces. `make` does its own heavy imports, so
    that names are listed without loading any policy. `in_rod` makes the policy for folds of the
    rod, where that is another one than for folds through images. `look` is how figures
    show the policy.
    """

    rank: int
    make: Callable[[Path | None], Policy]
    learned: bool = False
    in_rod: Callable[[Path | None], Policy] | None = None
    look: Look = PLAIN
