"""The files of a benchmark: benchmark.json, benchmark.html, and the main picture."""

import io
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cell.benchmark.claims import claims
from cell.benchmark.figures.displacement import main_picture
from cell.benchmark.page import page_of
from cell.benchmark.results import Results
from cell.benchmark.summary import rows
from cell.record.documents import plain, replace_file
from drivers.errors import ConfigurationError

DPI = 160


def write_results(results: Results, folder: Path) -> Path:
    """Write benchmark.json and benchmark.html into `folder`; the path of the page."""
    content = results.model_dump_json(by_alias=True, indent=1)
    _write(folder / "benchmark.json", content.encode())
    page = folder / "benchmark.html"
    _write(page, page_of(results).encode())
    return page


def write_main_picture(results: Results, path: Path) -> None:
    """The displacements on all strips as a PNG at `path`."""
    from matplotlib import rc_context

    content = io.BytesIO()
    with rc_context({"svg.fonttype": "path"}):
        main_picture(results).savefig(content, format="png", dpi=DPI, facecolor="white")
    _write(path, content.getvalue())


def lines(results: Results) -> list[dict[str, Any]]:
    """Objects for a program: a policy each, then a claim each; None for what is not known."""
    told = [{"kind": "policy", **asdict(row)} for row in rows(results)]
    claimed = [{"kind": "claim", **asdict(claim)} for claim in claims(results)]
    return [plain(line) for line in (*told, *claimed)]


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, content)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written: {error.strerror}") from None
