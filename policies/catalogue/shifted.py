"""Registry entry of the policy `shifted`; see `policies.fixed_paths`."""

from pathlib import Path

from policies.catalogue.entry import Entry, Look
from policies.policy import Policy


def _make(_: Path | None) -> Policy:
    from policies.fixed_paths import Shifted

    return Shifted()


ENTRY = Entry(rank=3, make=_make, look=Look("#6b7280", "D", 4.2))
