"""Fold requests by names of strip and policy, as `cell fold` makes them."""

from pathlib import Path

from cell.base.config.places import find_configs
from cell.base.devices.devices import Trial
from cell.folding.request import Request

CONFIGS = find_configs(None)
CELL, DENIM = CONFIGS.cell(), CONFIGS.strip("denim")


def request_for(
    strip: str, policy: str, runs: Path, configs: Path | None = None, **changes
) -> Request:
    """Fold request with seed 3; `changes` replace fields of the request."""
    found = find_configs(configs)
    facts = {"cell": found.cell(), "trial": Trial(seed=3)} | changes
    return Request(strip=found.strip(strip), policy=policy, runs=runs, **facts)
