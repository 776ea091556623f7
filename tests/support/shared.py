"""Cases, and measurements of others, that lie beside the checkout and not in it."""

from pathlib import Path

import pytest

from tests.support.rooms import ROOT

CASES, DATA = (ROOT.parent / "shared" / name for name in ("cases", "data"))
YARN = DATA / "yarn"
PHOTOGRAPHS = sorted(YARN.glob("*.jpg"))


def needs(folder: Path) -> pytest.MarkDecorator:
    """Mark of a test that is skipped where there is no such `folder`."""
    return pytest.mark.skipif(not folder.is_dir(), reason=f"{folder} is not there")
