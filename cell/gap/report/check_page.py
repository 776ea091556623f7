"""The page of a check: what is wrong with the recordings, and what they cannot say."""

from cell.gap.check import Check, Level
from cell.report.markup import Tone, masthead, page, section, table, verdict_box

TONES: dict[Level, Tone] = {"good": "good", "fair": "fair", "bad": "bad"}
HEADLINES: dict[Level, str] = {
    "good": "These runs can be fitted",
    "fair": "These runs can be fitted, with what is said below",
    "bad": "Nothing should be fitted to these runs as they are",
}


def check_page(found: Check, subject: str) -> str:
    """The page as text, self-contained."""
    groups = {
        "Mend before anything is fitted": [f for f in found.findings if f.level == "bad"],
        "Recordings": [f for f in found.findings if f.level == "fair" and f.what != IDENTIFIABLE],
        "What these runs cannot say": [f for f in found.findings if f.what == IDENTIFIABLE],
    }
    body = [
        masthead(f"Check of {len(found.runs)} runs", subject),
        verdict_box(TONES[found.level], HEADLINES[found.level], [_summary(found)]),
        *(
            section(title, table(HEAD, [(f.what, f.run or "all", f.words, f.remedy) for f in some]))
            for title, some in groups.items()
        ),
    ]
    return page(f"{subject}: check of its runs", body)


HEAD = ("what", "run", "seen", "do")
IDENTIFIABLE = "identifiable"


def _summary(found: Check) -> str:
    bad = sum(f.level == "bad" for f in found.findings)
    return (
        f"{len(found.findings)} findings, {bad} of them against a fit. The page holds for inputs "
        f"{found.inputs}: with other files it says nothing."
    )
