"""Puts what a ledger holds into the exam's page, and leaves what is written by hand as it is.

python -m tests.benchmarks.exam_page LEDGER [--page runbooks/exam.md]

Of the tiers in LEDGER the sections and figures are made anew; the introduction and the sections of
other tiers stay.
"""

import argparse
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from cell.exam.report.page import TIERS, by_tier, write_report
from cell.exam.scoring.results import Ledger
from drivers.files import replace_file


def main() -> int:
    """Write the page; 1 where it has no section of a tier that the ledger holds."""
    asked = _arguments()
    entries = sorted(Ledger(asked.ledger).entries, key=lambda entry: entry.case.name)
    page = asked.page.read_text(encoding="utf-8")
    with TemporaryDirectory() as name:
        made, *figures = write_report(entries, Path(name) / asked.page.name)
        new = made.read_text(encoding="utf-8")
        for tier, mine in by_tier(entries):
            section = _section(TIERS[tier])
            if not section.search(page):
                sys.stderr.write(f"{asked.page}: has no section '{TIERS[tier]}'; add its heading\n")
                return 1
            found = section.search(new)
            page = section.sub(lambda _, text=found: text[0].rstrip() + "\n\n", page)
            sys.stdout.write(f"{TIERS[tier]}: {len(mine)} cases\n")
        for figure in figures:
            replace_file(asked.page.with_name(figure.name), figure.read_bytes())
    replace_file(asked.page, (page.rstrip() + "\n").encode())
    return 0


def _section(heading: str) -> re.Pattern[str]:
    """A section with its heading, up to the next one of its level or the end."""
    return re.compile(rf"^## {re.escape(heading)}\n.*?(?=^## |\Z)", re.DOTALL | re.MULTILINE)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("ledger", type=Path)
    parser.add_argument("--page", type=Path, default=Path("runbooks/exam.md"))
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
