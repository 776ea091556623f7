"""Registry entry of the policy `triangular`; see `policies.fixed_paths`."""

from pathlib import Path

from policies.catalogue.entry import Entry, Look
from policies.policy import Policy


def _make(_: Path | None) -> Policy:
    from policies.fixed_paths import Triangular

    return Triangular()


ENTRY = Entry(rank=1, make=_make, look=Look("#2f6db5", "<"))
