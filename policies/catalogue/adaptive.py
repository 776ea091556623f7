"""`adaptive`, for strips that nobody measured: see `policies.adaptive`."""

from pathlib import Path

from policies.catalogue.entry import Entry
from policies.policy import Policy


def _make(checkpoint: Path | None) -> Policy:
    from policies.adaptive.adaptive import Adaptive
    from policies.adaptive.bias import THROUGH_IMAGES
    from policies.adaptive.checkpoint import load_critic

    return Adaptive(load_critic(checkpoint), THROUGH_IMAGES)


def _in_rod(checkpoint: Path | None) -> Policy:
    from policies.adaptive.adaptive import Adaptive
    from policies.adaptive.checkpoint import load_critic

    return Adaptive(load_critic(checkpoint))


ENTRY = Entry(rank=6, make=_make, learned=True, in_rod=_in_rod)
