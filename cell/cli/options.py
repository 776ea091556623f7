"""Options that several commands share."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer


def policy_names() -> str:
    """Names of the policies, from their file names: importing them would make `--help` slow."""
    found = find_spec("policies.catalogue")
    places = [] if found is None else list(found.submodule_search_locations or ())
    names = {path.stem for place in places for path in Path(place).glob("[a-z]*.py")}
    return ", ".join(sorted(names - {"entry"}))


Runs = Annotated[Path, typer.Option("--runs", help="Folder in which runs are recorded.")]
Configs = Annotated[
    Path | None,
    typer.Option("--configs", help="Folder with cell.yaml and strips/ [default: ./configs]."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object a line.")]
