"""Renews the sections of the exam's pages that come from ledgers; hand-written text
stays.

python -m tests.lab exam-page LEDGER... [--page tests/lab/notes/exam.md]
    [--cases tests/lab/ledgers/cases.md]

Of the tiers in the LEDGERs, taken together, the sections are made anew: on the page the
table of the bars and that by kind of plant, among the cases all tables. The
introductions and the sections of other tiers stay.
"""

import re
import sys
from pathlib import Path

from drivers.base.files import replace_file
from tests.lab.exam.ledger import read_ledger
from tests.lab.exam.page import TIERS, by_tier, markdown


def main(
    ledgers: list[Path],
    page: Path = Path("tests/lab/notes/exam.md"),
    cases: Path = Path("tests/lab/ledgers/cases.md"),
) -> int:
    """Write both pages; returns 1 where one has no section of a tier in the ledgers."""
    entries = [entry for ledger in ledgers for entry in read_ledger(ledger).values()]
    entries.sort(key=lambda entry: entry.case.name)
    pages = {path: path.read_text(encoding="utf-8") for path in (page, cases)}
    made = markdown(entries)
    for tier, mine in by_tier(entries):
        # a heading, up to the next
        pattern = rf"^## {re.escape(TIERS[tier])}\n.*?(?=^## |\Z)"
        section = re.compile(pattern, re.DOTALL | re.MULTILINE)
        whole = section.search(made)[0].rstrip()
        brief = "\n### ".join(whole.split("\n### ")[:2])
        for path, text in {cases: whole, page: brief}.items():
            if not section.search(pages[path]):
                sys.stderr.write(
                    f"{path}: has no section '{TIERS[tier]}'; add its heading\n"
                )
                return 1
            pages[path] = section.sub(
                lambda _, text=text: text.rstrip() + "\n\n", pages[path]
            )
        sys.stdout.write(f"{TIERS[tier]}: {len(mine)} cases\n")
    for path, text in pages.items():
        replace_file(path, (text.rstrip() + "\n").encode())
    return 0
