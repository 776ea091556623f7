"""Registry entry of the policy `adaptive`, for unmeasured strips; see `policies.adaptive`."""

from pathlib import Path

from policies.catalogue.entry import Entry, Look
from policies.policy import Policy


def _make(checkpoint: Path | None) -> Policy:
    from policies.adaptive.adaptive import Adaptive
    from policies.adaptive.checkpoint import load_critic, load_transfer

    return Adaptive(load_critic(checkpoint), load_transfer(checkpoint))


def _in_rod(checkpoint: Path | None) -> Policy:
    from policies.adaptive.adaptive import Adaptive
    from policies.adaptive.checkpoint import load_critic

    return Adaptive(load_critic(checkpoint))


ENTRY = Entry(rank=6, make=_make, learned=True, in_rod=_in_rod, look=Look("#c2352b", "P"))
