"""The fold that many claims read."""

import pytest

from cell.folding.request import RecordingOptions
from tests.end_to_end.folded import Folded, fold_and_keep
from tests.support.requests import request_for


@pytest.fixture(scope="session")
def denim(tmp_path_factory: pytest.TempPathFactory) -> Folded:
    runs = tmp_path_factory.mktemp("denim")
    return fold_and_keep(
        request_for("denim", "triangular", runs, record=RecordingOptions("all"))
    )
