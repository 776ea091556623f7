"""Options that several commands share, and checks of the values given."""

import os
import sys
from contextlib import contextmanager
from functools import wraps
from inspect import signature
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from cell.base.config.drivers import Kind, driver_names
from cell.base.config.length import metres
from cell.base.config.places import PACKAGED, Configs as Found, find_configs
from cell.interface.cli.output import notice
from cell.record.files import run_folder
from drivers.base.errors import ConfigurationError, check_known
from drivers.base.plugins import plugin_names

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from cell.base.campaign.run import Engine
    from cell.folding.request import Request
    from cell.folding.series import Remainder

T = TypeVar("T")
INTERRUPTED_CODE = 130  # exit code


def taking(options: type[T]) -> "Callable[[Callable[[T], None]], Callable[..., None]]":
    """Decorator of a command whose many options arrive as one dataclass of the type
    `options`.
    """

    def decorate(command: "Callable[[T], None]") -> "Callable[..., None]":
        @wraps(command)
        def take(**given: Any) -> None:
            command(options(**given))

        # by which Typer knows the options
        vars(take)["__signature__"] = signature(options)
        return take

    return decorate


def length_option(option: str, says: str, bare: str = "m", least: float = -inf) -> Any:
    """Option that takes a length of `least` [m] or more with a unit, in metres for the
    command.
    """

    def parse(text: str) -> float:
        return metres(option, str(text), bare=bare, least=least)

    return typer.Option(option, parser=parse, metavar="LENGTH", help=says)


def policy_names() -> list[str]:
    """Names of all policies; plug-ins are not imported, which would slow `--help`
    down.
    """
    from policies.registry import OWN_POLICIES

    return sorted({*OWN_POLICIES, *plugin_names("policies")})


def strip_names(context: typer.Context) -> list[str]:
    """Names of strips for completion in a shell; empty without a configuration."""
    try:
        return list(find_configs(context.params.get("configs")).strip_names())
    except ConfigurationError:
        return []


def check_names(found: Found, strip: str, policy: str | None = None) -> None:
    """Raise ConfigurationError for the name of a strip or policy that does not exist.

    Reads no file and imports nothing heavy, so that a misspelt name is answered at
    once.
    """
    if strip.partition(":")[0] != "unknown":
        found.strip_path(strip)
    if policy is not None and ":" not in policy:
        check_known("--policy", policy, policy_names())


def writable(configs: Path | None) -> Found:
    """Folder of configuration; raises ConfigurationError for the package's own
    folder.
    """
    found = find_configs(configs)
    if found.folder == PACKAGED:
        raise ConfigurationError(
            f"--configs: {found.folder} belongs to the package; copy it and name the"
            " copy"
        )
    return found


def check_readable(path: Path, remedy: str = "") -> None:
    """Raise ConfigurationError, with a `remedy`, for a file that cannot be opened."""
    try:
        os.close(os.open(path, os.O_RDONLY | os.O_NONBLOCK))  # a pipe is not waited for
    except OSError as error:
        raise ConfigurationError(
            f"{path}: cannot be read: {error.strerror}{remedy}"
        ) from None


def _driver_option(kind: Kind) -> Any:
    """Option whose value is the name of a driver of this `kind` of device."""
    names = driver_names(kind)

    def check(value: str) -> str:
        if value not in names:
            raise typer.BadParameter(
                f"{value!r} is not one of {', '.join(map(repr, names))}."
            )
        return value

    device = kind.removesuffix("s").capitalize()
    return typer.Option(
        help=f"{device} driver.", parser=check, metavar=f"<{'|'.join(names)}>"
    )


Strip = Annotated[
    str,
    typer.Option(
        "--strip",
        help="Strip by name, or a path to its .yaml file.",
        autocompletion=strip_names,
    ),
]
PLANT_HELP = (
    "Strip on the twin's desk: a name in configs/plants, or a path to a .yaml file"
)
Arm = Annotated[str | None, _driver_option("arms")]
Camera = Annotated[str | None, _driver_option("cameras")]
Run = Annotated[
    Path,
    typer.Argument(metavar="RUN", parser=run_folder, help="A run folder, or last."),
]
RunFolders = Annotated[
    list[Path], typer.Argument(metavar="RUN", parser=run_folder, help="Run folders.")
]
Runs = Annotated[
    Path, typer.Option("--runs", help="Folder in which runs are recorded.")
]
Configs = Annotated[
    Path | None,
    typer.Option(
        "--configs", help="Folder with cell.yaml and strips/ [./configs or packaged]."
    ),
]
Viz = Literal["save", "live", "off"]


def said_where(viz: Viz) -> Viz:
    """Say where a live view is to be seen if there is no screen for it here."""
    if viz == "live":
        from cell.report.viz.opening import NO_SCREEN, has_screen

        if not has_screen():
            typer.echo(NO_SCREEN, err=True)
    return viz


VizOption = Annotated[
    Viz,
    typer.Option(
        help="Rerun: save a recording, show it live too, off.", callback=said_where
    ),
]
FullSpeed = Annotated[
    bool, typer.Option("--full-speed", help="A real robot not slowed to a tenth.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object a line.")]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster", help="Measure on the Dask cluster at this address instead."
    ),
]


def ask(question: str) -> str:
    """Print `question` and return the line that the operator types as an answer."""
    print(question, end="", file=sys.stderr, flush=True)
    return sys.stdin.readline()


@contextmanager
def resumable(folder: Path, *marks: str) -> "Iterator[None]":
    """Within the block, keep results in `folder`, and answer Ctrl-C by the way on.

    Exits with code 130 then. With `marks`, by which the command knows folders of its
    own, raises ConfigurationError for one with other files.
    """
    from cell.orchestrator.operator import Interrupted
    from drivers.base.outputs import check_output_folder

    if marks:
        check_output_folder(folder, *marks)
    try:
        yield
    except (KeyboardInterrupt, Interrupted):
        print(
            f"interrupted; what is finished is kept in {folder}: run the command again"
            " to resume",
            file=sys.stderr,
        )
        sys.exit(INTERRUPTED_CODE)


@contextmanager
def folded_series(
    requests: "Sequence[Request]",
    kind: str,
    path: Path | None = None,
    *,
    resuming: bool = False,
) -> "Iterator[Remainder]":
    """Within the block, make a series of folds; at its end say how to go on if a part
    is left.

    Exits with code 130 after Ctrl-C.
    """
    from cell.folding.series import series_of
    from cell.orchestrator.operator import Interrupted

    with series_of(requests, kind, path, resuming=resuming) as remainder:
        for sentence in remainder.sentences() if resuming else ():
            notice(sentence)
        try:
            yield remainder
        except (KeyboardInterrupt, Interrupted):
            sys.exit(INTERRUPTED_CODE)
        finally:
            if way_on := remainder.series.way_on():
                notice(way_on)


def engine(jobs: int, address: str | None, limit: float | None) -> "Engine":
    """Engine of a campaign: `jobs` processes here, or a Dask cluster at `address`.

    A part may take `limit` [s]. Raises ConfigurationError for an address with several
    jobs.
    """
    from cell.base.campaign.run import Local

    if address is None:
        return Local(jobs, limit)
    if jobs > 1:
        raise ConfigurationError(
            "--jobs: a cluster has its own workers; leave --jobs out"
        )
    from cell.base.campaign.cluster import Cluster

    return Cluster(address, limit)
