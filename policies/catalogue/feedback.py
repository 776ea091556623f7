"""Registry entry of the policy `feedback`, the paper's policy; see `policies.feedback`."""

from pathlib import Path

from policies.catalogue.entry import Entry, Look
from policies.policy import Policy


def _make(checkpoint: Path | None) -> Policy:
    from policies.feedback import load_feedback

    return load_feedback(checkpoint)


ENTRY = Entry(rank=5, make=_make, learned=True, look=Look("#3a8a5c", size=7.0))
