"""Stores the drawn cases of an exam, so that another engine is examined on the same cases."""

import json
from pathlib import Path

from pydantic import ValidationError

from drivers.errors import ConfigurationError
from drivers.files import replace_file, writing
from tests.lab.exam.case import Case, Kind, Tier
from tests.lab.exam.cases.answer_key import KEYS_FOLDER
from tests.lab.exam.progress import Progress, quiet

DRAWN_FILE = "drawn.json"
CASE_COUNTS = {"state": 300, "images": 90, "small": 6}


def load_or_draw(
    folder: Path,
    tier: str,
    count: int | None,
    seed: int,
    repeats: int = 1,
    kind: Kind | None = None,
    force: float | None = None,
    progress: Progress = quiet,
    jobs: int = 1,
) -> tuple[Case, ...]:
    """Load the cases stored in `folder` for the same request, or draw them in `jobs` processes.

    From the state each motion is made `repeats` times; with a `kind` all cases are of that kind;
    with a `force` [N] the arm reports the strip's force with that noise, all else being equal.
    Raises ConfigurationError where the folder holds another exam or cannot be written, for repeats
    through images and for causes outside the library without images.
    """
    if repeats > 1 and tier == "images":
        raise ConfigurationError("--repeats: is for exams from the state; leave it out")
    if kind == "outside" and tier != "images":
        raise ConfigurationError("--kind outside: is for exams through images; add --tier images")
    path = folder / KEYS_FOLDER / DRAWN_FILE
    wanted = count or CASE_COUNTS[tier]
    options = {"repeats": repeats if repeats > 1 else None, "kind": kind, "force": force}
    asked: dict[str, object] = {"tier": tier, "count": wanted, "seed": seed}
    asked |= {option: value for option, value in options.items() if value}
    known = _read(path)
    if known is None:
        from tests.lab.exam.cases.draw import cases

        of: Tier = "images" if tier == "images" else "state"
        drawn = cases(of, wanted, seed, kind, progress, jobs)
        found = tuple(c.model_copy(update={"repeats": repeats, "force": force}) for c in drawn)
        _keep(path, {**asked, "cases": [case.model_dump(mode="json") for case in found]})
        return found
    held = {key: known.get(key) for key in asked}
    if held != asked:
        given = " ".join(f"{key} {value}" for key, value in held.items())
        raise ConfigurationError(f"--out: {folder} holds another exam ({given}); name a new folder")
    return _cases(path, known)


def _read(path: Path) -> dict[str, object] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}; remove the folder") from None
    return content if isinstance(content, dict) else {}


def _cases(path: Path, known: dict[str, object]) -> tuple[Case, ...]:
    held = known.get("cases")
    try:
        return tuple(Case.model_validate(c) for c in (held if isinstance(held, list) else []))
    except ValidationError:
        raise ConfigurationError(
            f"{path}: was drawn by another version; name a new folder"
        ) from None


def _keep(path: Path, content: dict[str, object]) -> None:
    with writing(f"--out: {path}"):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        replace_file(path, json.dumps(content, indent=1).encode())
    path.chmod(0o600)
