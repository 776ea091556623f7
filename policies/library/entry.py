"""How a policy is listed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from policies.policy import Policy


@dataclass(frozen=True, slots=True)
class Entry:
    """A policy's maker, called with a checkpoint or None, and its `rank` in lists.

    A `learned` policy has weights that a checkpoint replaces. What `make` needs, it imports
    itself: names are listed without loading any policy.
    """

    rank: int
    make: Callable[[Path | None], Policy]
    learned: bool = False
