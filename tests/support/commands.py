"""Commands of `cell` as a shell calls them, in this process."""

import shlex
from collections.abc import Iterable
from itertools import chain
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from cell.__main__ import main
from cell.interface.cli.app import app


def invoke(*words: object, **options: Any) -> Result:
    """Result of `cell` called with `words`: texts as a shell splits them, and values;
    `options` as of `CliRunner`.
    """
    return CliRunner().invoke(app, _split(words), **options)


def _split(words: Iterable[object]) -> list[str]:
    split = (shlex.split(w) if isinstance(w, str) else [str(w)] for w in words)
    return list(chain.from_iterable(split))


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    """Exit code of `cell` called with `words`: texts as a shell splits them, and
    values.
    """
    monkeypatch.setattr("sys.argv", ["cell", *_split(words)])
    # else `python -m pytest` is named
    monkeypatch.setattr("__main__.__package__", None)
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object
) -> str:
    """Error text of a `cell` command that must be refused as bad input."""
    code = run(monkeypatch, *words)
    told = capsys.readouterr()
    assert code == 2, told
    assert told.out == ""
    assert "Traceback" not in told.err
    assert told.err.startswith("cell: ")
    return told.err.removeprefix("cell: ").strip()
