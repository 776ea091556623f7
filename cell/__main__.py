"""`python -m cell` and the `cell` command: the edge where errors become one line each."""

import sys

from drivers.errors import CellError


def main() -> None:
    """Run the command line; an expected error is its message and its exit code."""
    from cell.cli.app import app

    try:
        app(standalone_mode=True)
    except CellError as error:
        sys.stderr.write(f"cell: {error}\n")
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.stderr.write("cell: interrupted\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
