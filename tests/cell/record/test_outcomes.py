"""Every name by which the program ends a run is known to those who read runs."""

import re
from pathlib import Path

from cell.orchestrator.monitors import MONITORS
from cell.record.header import is_outcome

ROOT = Path(__file__).parents[3]


def test_every_fault_in_the_sources_is_an_outcome() -> None:
    names = {monitor.name for monitor in MONITORS}
    for folder in ("cell", "drivers", "calibration", "policies"):
        for path in (ROOT / folder).rglob("*.py"):
            names |= set(re.findall(r'\bFault\(\s*"(\w+)"', path.read_text(encoding="utf-8")))
    assert len(names) > 20
    assert [name for name in sorted(names) if not is_outcome(name)] == []
    assert not is_outcome("banana")
