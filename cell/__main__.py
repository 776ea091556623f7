"""Entry point of `python -m cell` and of the command `cell`; an error is printed in one
line.
"""

import atexit
import gc
import os
import sys
from typing import TYPE_CHECKING, Any

from drivers.base.errors import CellError, ConfigurationError

if TYPE_CHECKING:
    from typer import Typer

# between collections: fewer, and libraries' objects are searched in vain
YOUNG_OBJECTS = 50_000


def command() -> None:
    """Run the command line as a process that exits at once, without freeing objects one
    by one.
    """
    codes = list[int]()
    # registered first, it is called last
    atexit.register(lambda: codes and os._exit(codes[0]))
    try:
        main()
    except SystemExit as end:
        codes += [end.code] if isinstance(end.code, int) else []
        raise


def main(app: "Typer | None" = None) -> None:
    """Run the command line `app`; an error is printed in one line and sets the exit
    code.
    """
    from cell.interface.cli.output import guard_streams, why_lost

    gc.set_threshold(YOUNG_OBJECTS)
    out = guard_streams()
    code = _run(app)
    sys.stdout.flush()
    if why_lost(out):
        print(f"cell: what was printed was lost: {why_lost(out)}", file=sys.stderr)
    sys.stderr.flush()
    sys.exit(code)


def _run(app: "Typer | None") -> int | str | None:
    """Run the command line; returns its exit code."""
    from cell.interface.cli.app import app as cell

    try:
        code_of_exit = (app or cell)(standalone_mode=False)
        return int(code_of_exit or 0)
    except SystemExit as end:
        return end.code
    except Exception as error:  # noqa: BLE001  an edge: an operator is not shown a traceback
        return _print_error(error)


def _print_error(error: Exception) -> int:
    """Show `error` in one line, or the help of a bare command group; returns the exit
    code.
    """
    from typer import Abort, BadParameter

    # of all misuse; no version of Typer exports it
    usage: type = BadParameter.__mro__[1]
    if isinstance(error, usage):
        return _show_usage(error)
    if isinstance(error, Abort):
        return _print_error_line(CellError("no answer was given"))
    return _print_error_line(_cell_error(error))


def _show_usage(error: Any) -> int:
    """Show a misuse in one line, or the help where a command group stands alone."""
    ctx = error.ctx
    if ctx is not None and error.message == ctx.get_help():
        error.show()
        return int(error.exit_code)
    command = "cell" if ctx is None else ctx.command_path
    text = error.format_message().replace("Value error, ", "").rstrip(".")
    text = f"{text[:1].lower()}{text[1:]}; `{command} --help` lists what goes"
    parameters = ctx.command.params if ctx else ()
    takes_runs = any("--runs" in parameter.opts for parameter in parameters)
    if takes_runs and "extra argument" in error.message:
        text += "; a folder of runs goes after `--runs`"
    return _print_error_line(ConfigurationError(text))


def _cell_error(error: Exception) -> CellError:
    """Convert `error` to a CellError: a missing library, or a defect of this
    program.
    """
    from drivers.base.errors import Unexpected
    from drivers.base.extras import FEATURES, missing_library

    if isinstance(error, CellError):
        return error
    if isinstance(error, ModuleNotFoundError) and error.name in FEATURES:
        return missing_library(str(error.name))
    return Unexpected(error)


def _print_error_line(error: CellError) -> int:
    sys.stdout.flush()
    print(f"cell: {error}", file=sys.stderr)
    return error.exit_code


if __name__ == "__main__":
    command()
