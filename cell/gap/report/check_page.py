"""HTML page of a check: what is wrong with the recordings, and what they cannot identify."""

from cell.gap.check import IDENTIFIABLE, Check, Level
from cell.report.html import page
from cell.report.page_verdict import PageVerdict
from cell.report.words import plural

HEADLINES: dict[Level, str] = {
    "good": "These runs can be fitted",
    "fair": "These runs can be fitted; mind the findings below",
    "bad": "Nothing should be fitted to these runs as they are",
}


def check_page(found: Check, subject: str) -> str:
    """HTML text of the self-contained page of `found`, the check of `subject`."""
    groups = {
        "Mend before anything is fitted": [f for f in found.findings if f.level == "bad"],
        "Recordings": [f for f in found.findings if f.level == "fair" and f.what != IDENTIFIABLE],
        "What these runs cannot say": [f for f in found.findings if f.what == IDENTIFIABLE],
    }
    return page(
        "gap/report/check.html",
        f"{subject}: check of its runs",
        kicker=f"Check of {len(found.runs)} runs",
        name=subject,
        said=PageVerdict(found.level, HEADLINES[found.level], (_summary(found),)),
        groups=[
            (title, [(f.what, f.run or "all", f.words, f.remedy) for f in some])
            for title, some in groups.items()
        ],
    )


def _summary(found: Check) -> str:
    bad = sum(f.level == "bad" for f in found.findings)
    return f"{plural(len(found.findings), 'finding')}, {bad} of them against a fit."
