"""`cell strips`."""

import json
import sys

from cell.cli.options import Configs, Json


def strips(configs: Configs = None, as_json: Json = False) -> None:
    """List the strips that this cell knows, with what matters for a fold."""
    from rich.console import Console
    from rich.table import Table

    from cell.config.places import find_configs

    found = find_configs(configs)
    known = [found.strip(name) for name in found.strip_names()]
    if as_json:
        for strip in known:
            sys.stdout.write(json.dumps(strip.model_dump(mode="json", by_alias=True)) + "\n")
        return
    table = Table(title=f"Strips in {found.folder / 'strips'}")
    for name in ("strip", "length mm", "width mm", "g/m²", "bending mm", "retardation ms"):
        table.add_column(name, justify="left" if name == "strip" else "right")
    for strip in known:
        numbers = [strip.length, strip.width, strip.areal_density]
        numbers += [strip.bending_length, strip.retardation_time]
        table.add_row(strip.name, *(f"{1e3 * number:.4g}" for number in numbers))
    Console().print(table)
