"""Registry entry of the policy `planned`; see `policies.planned`."""

from pathlib import Path

from policies.catalogue.entry import Entry, Look
from policies.policy import Policy


def _make(_: Path | None) -> Policy:
    from policies.planned import Planned

    return Planned()


ENTRY = Entry(rank=4, make=_make, look=Look("#8a5fb0", "s", 4.2))
