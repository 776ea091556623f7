"""Made-up results of folds."""

from dataclasses import replace

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
