"""Options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

Runs = Annotated[Path, typer.Option("--runs", help="Folder in which runs are recorded.")]
Configs = Annotated[
    Path | None,
    typer.Option("--configs", help="Folder with cell.yaml and strips/ [default: ./configs]."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object a line.")]
