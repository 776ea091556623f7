"""`python -m cell` and the `cell` command: the edge where errors become one line each."""

import sys

from drivers.errors import CellError


def main() -> None:
    """Run the command line; an error is one line and its exit code, never a traceback."""
    from cell.cli.app import app

    try:
        app(standalone_mode=True)
    except CellError as error:
        _end(error)
    except Exception as error:  # noqa: BLE001  an edge: an operator is not shown a traceback
        from drivers.errors import Unexpected

        _end(Unexpected(error))


def _end(error: CellError) -> None:
    sys.stdout.flush()
    sys.stderr.write(f"cell: {error}\n")
    sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
