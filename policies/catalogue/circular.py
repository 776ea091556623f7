"""Registry entry of the policy `circular`; see `policies.fixed_paths`."""

from pathlib import Path

from policies.catalogue.entry import Entry, Look
from policies.policy import Policy


def _make(_: Path | None) -> Policy:
    from policies.fixed_paths import Circular

    return Circular()


ENTRY = Entry(rank=2, make=_make, look=Look("#cf6a1f", ">"))
