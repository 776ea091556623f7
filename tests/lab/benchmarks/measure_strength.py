"""Measures how strong the effects that an exam hid are, against the strength that it states.

python -m tests.lab measure-strength LEDGER [--effects grip_slip end_slip]

Of every hidden effect alone: the gap that it leaves on the model once the base is refitted, over
the gap of its strength. Effects with a threshold, such as slips, may leave far less or more.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.lab.exam.case import STRENGTHS, Case
from tests.lab.exam.cases import JUMP, ruler_of
from tests.lab.exam.ledger import Ledger

LEAST = 0.5  # of the asked gap, below which an effect is hardly there


def main() -> int:
    """Print a line for each hidden effect, and how many are as strong as stated."""
    asked = _arguments()
    cases = sorted((entry.case for entry in Ledger(asked.ledger).entries), key=lambda c: c.name)
    ratios = []
    for case in cases:
        for name, ratio in _ratios(case, asked.effects):
            sys.stdout.write(f"{case.name}  {case.plant}  {case.strength} {name}  {ratio:.2f}\n")
            ratios.append(ratio)
    sys.stdout.write(
        f"{len(ratios)} effects: {sum(r < LEAST for r in ratios)} leave less than {LEAST:g} of "
        f"the asked gap, {sum(r > JUMP for r in ratios)} more than {JUMP:g}\n"
    )
    return 0


def _ratios(case: Case, names: list[str]) -> Iterator[tuple[str, float]]:
    """Name and gap over the asked one, of each effect of `case` among `names`; all where empty."""
    for name, values in case.effects.items():
        if case.strength is not None and (not names or name in names):
            excess = ruler_of(case).excess([{name: values}])[0]
            yield name, float(excess) / STRENGTHS[case.strength]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("ledger", type=Path)
    parser.add_argument("--effects", nargs="*", default=[])
    return parser.parse_args()
