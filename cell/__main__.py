"""`python -m cell` and the `cell` command: the edge where errors become one line each."""

import sys

from drivers.errors import CellError


def main() -> None:
    """Run the command line; an error is one line and its exit code, never a traceback."""
    from cell.cli.streams import guard_streams, why_lost

    out = guard_streams()
    code = _run()
    sys.stdout.flush()
    if why_lost(out):
        sys.stderr.write(f"cell: what was printed was lost: {why_lost(out)}\n")
    sys.stderr.flush()
    sys.exit(code)


def _run() -> int | str | None:
    from cell.cli.app import app

    try:
        app(standalone_mode=True)
    except SystemExit as end:
        return end.code
    except CellError as error:
        return _show(error)
    except ModuleNotFoundError as error:
        from cell.extras import FEATURES, missing_library
        from drivers.errors import Unexpected

        known = error.name in FEATURES
        return _show(missing_library(str(error.name)) if known else Unexpected(error))
    except Exception as error:  # noqa: BLE001  an edge: an operator is not shown a traceback
        from drivers.errors import Unexpected

        return _show(Unexpected(error))
    return 0


def _show(error: CellError) -> int:
    sys.stdout.flush()
    sys.stderr.write(f"cell: {error}\n")
    return error.exit_code


if __name__ == "__main__":
    main()
