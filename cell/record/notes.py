"""An operator's tags of a run and the note on it, in notes.yaml."""

from collections.abc import Iterable
from pathlib import Path

from cell.record.files import NOTES
from cell.record.header import Recorded
from drivers.files import change_file
from drivers.settings import parse
from drivers.yaml_text import dump_yaml, parse_yaml


class Notes(Recorded):
    """Contents of notes.yaml; `tags` are separated by spaces."""

    tags: str = ""
    note: str = ""


def annotate(
    run: Path, add: Iterable[str] = (), remove: Iterable[str] = (), text: str | None = None
) -> str:
    """Add and remove tags of the run in the folder `run`; `text`, if any, becomes its note.

    Returns the tags, separated by spaces. Raises ConfigurationError, and changes nothing, where
    the notes cannot be read or written.
    """
    path, tags = run / NOTES, ""

    def change(old: str) -> str:
        nonlocal tags
        content = parse_yaml(old, str(path)) if old else {}
        notes = parse(content, Notes, str(path))
        tags = " ".join(sorted({*notes.tags.split(), *add} - set(remove)))
        note = notes.note if text is None else text
        return dump_yaml({"schema": 1, **content, "tags": tags, "note": note})

    change_file(path, change)
    return tags
