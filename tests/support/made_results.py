"""Made-up results of folds."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from cell.folding import batch
from cell.folding.result import FoldResult

DONE = FoldResult(
    run="runs/one",
    strip="denim",
    policy="triangular",
    seed=0,
    outcome="layer_touch",
    reason="the layers touch",
    displacement=-0.0337654321,
    displacement_true=None,
    layer_touch=5.46789,
    edge_offset=-0.03,
    edge_offset_true=None,
    duration=16.76,
    wall=8.1,
    calibration="0123456789ab",
    exit_code=0,
)
STOPPED = replace(DONE, outcome="interrupted", displacement=None, layer_touch=None, exit_code=130)


def fold_by(monkeypatch: pytest.MonkeyPatch, fold: Callable, **others: Callable) -> None:
    """Batches fold by `fold`, without calibration and pages unless by `others`."""
    plain = {"calibration_of": lambda *_: None, "write_pages": lambda _, result: result}
    for name, function in ({"fold": fold} | plain | others).items():
        monkeypatch.setattr(batch, name, function)
