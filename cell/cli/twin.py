"""The command `cell twin serve`: serves the arm's twin by the robot's own network protocol."""

import sys
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Json, say

twin = typer.Typer(
    help="The digital twin of the arm, for unmodified clients of the real one.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@twin.callback()
def the_twin() -> None:
    """The digital twin of the arm, for unmodified clients of the real one."""


@twin.command()
def serve(
    address: Annotated[
        str | None,
        typer.Option(help="IPv4 address to listen at [default: a free one on the loopback]."),
    ] = None,
    lock_step: Annotated[
        bool,
        typer.Option(
            "--lock-step/--wall-clock",
            help="A motion advances with its client's commands, or by the clock at 1 kHz.",
        ),
    ] = True,
    faults: Annotated[
        Path | None, typer.Option(help="File with faults that strike at scripted ticks.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Serve arm (port 1337) and hand (port 1338) until interrupted; the robot alone, no strip."""
    from drivers.fci_server.faults import load_faults
    from drivers.fci_server.server import RobotServer, ServerSettings
    from drivers.settings import parse

    asked = {"lock_step": lock_step} | ({} if address is None else {"address": address})
    settings = parse(asked, ServerSettings, "cell twin serve")
    script = () if faults is None else load_faults(faults)
    server = RobotServer(settings, faults=script)
    _print_address(server.address, lock_step, as_json)
    try:
        server.serve()
    except KeyboardInterrupt:
        sys.stderr.write("stopped\n")


def _print_address(address: str, lock_step: bool, as_json: bool) -> None:
    clock = "lock-step" if lock_step else "wall clock"
    facts = {"address": address, "arm": 1337, "hand": 1338, "clock": clock}
    say(facts, f"arm at {address}:1337, hand at {address}:1338, {clock}", as_json=as_json)
    if not ip_address(address).is_loopback:
        sys.stderr.write(f"{address} is no loopback address: others on the network can connect\n")
    sys.stdout.flush()
