"""Every fault of the robot in every phase of a fold: `python -m tests.benchmarks.arm_faults`.

Prints a table and ends with 1 where an outcome is not the expected one, the arm does not rest, the
record is not whole, or something hung for 2 s. Names of faults or phases as arguments choose some.
"""

import sys
import tempfile
from pathlib import Path

from tests.support.arm_faults import PHASES, STRIKES, Came, struck


def main(words: list[str]) -> int:
    faults = [fault for fault in STRIKES if fault in words] or list(STRIKES)
    phases = [phase for phase in PHASES if phase in words] or list(PHASES)
    print("| fault | phase | outcome | at rest | record whole | longest wait [s] | passed |")
    print("|---|---|---|---|---|---|---|", flush=True)
    came = [_told(fault, phase) for fault in faults for phase in phases]
    print(f"\n{sum(c.passed for c in came)} of {len(came)} as expected")
    return 0 if all(c.passed for c in came) else 1


def _told(fault: str, phase: str) -> Came:
    with tempfile.TemporaryDirectory() as runs:
        came = struck(fault, phase, Path(runs))
    words = [came.outcome, _yes(came.rests), _yes(came.whole), f"{came.hang:.2f}"]
    print(f"| {fault} | {phase} | {' | '.join(words)} | {_yes(came.passed)} |", flush=True)
    return came


def _yes(fact: bool) -> str:
    return "yes" if fact else "NO"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
