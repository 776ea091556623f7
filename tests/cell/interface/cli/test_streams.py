"""Whatever becomes of the terminal, a command does its work and ends with its own
code.
"""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cell.interface.cli.output import Outlet

CELL = [sys.executable, "-m", "cell"]
FOLD = """
import sys
from pathlib import Path
from pytest import MonkeyPatch
from tests.support.made_results import DONE, fold_by
from dataclasses import replace

def fold(request, *_more, **_named):
    Path("record").write_text("written")
    return replace(DONE, outcome="path_done", displacement=None, exit_code=1)

fold_by(MonkeyPatch(), fold)
from cell.__main__ import main
main()
"""


def shell(
    command: str, cwd: Path, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    tree = str(Path(__file__).parents[4])
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", command],
        cwd=cwd,
        capture_output=True,
        check=False,
        timeout=300,
        env={**os.environ, "PYTHONPATH": tree, "CELL": " ".join(CELL), **environment},
    )


def clean(done: subprocess.CompletedProcess[bytes]) -> bool:
    said = done.stdout + done.stderr
    return not any(
        word in said for word in (b"Traceback", b"defect", b"Exception ignored")
    )


@pytest.mark.parametrize(
    ("redirect", "code"),
    [
        ("$CELL strips >&-", 0),
        ("$CELL strips | true", 0),
        ("$CELL runs --runs nope 2>/dev/full", 2),
        ("$CELL runs --runs nope >&- 2>&- <&-", 2),
    ],
)
def test_output_that_goes_nowhere_changes_no_exit_code(
    tmp_path, redirect, code
) -> None:
    done = shell(redirect, tmp_path)
    assert done.returncode == code
    assert clean(done)


@pytest.mark.parametrize("redirect", ["| true", ">/dev/full"])
def test_a_fold_is_recorded_and_ends_with_its_own_code(tmp_path, redirect) -> None:
    (tmp_path / "fold.py").write_text(FOLD)
    done = shell(
        f"{sys.executable} fold.py fold --strip denim --viz off {redirect}", tmp_path
    )
    assert done.returncode == 1
    assert (tmp_path / "record").read_text() == "written"
    assert clean(done)
    assert (b"what was printed was lost: No space left" in done.stderr) == (
        redirect == ">/dev/full"
    )


def test_names_that_are_not_utf8_are_reported_in_one_line(tmp_path) -> None:
    (tmp_path / os.fsdecode(b"\xff")).mkdir()
    for command in (
        "report $'\\xff'",
        "fold --strip $'\\xff.yaml'",
        "gap advise $'\\xff'",
    ):
        done = shell(f"$CELL {command}", tmp_path)
        assert done.returncode == 2
        assert done.stderr.startswith(rb"cell: \udcff")
        assert clean(done)


def test_what_is_printed_never_lands_in_a_file_that_was_opened_later(tmp_path) -> None:
    script = (
        "from cell.interface.cli.output import guard_streams\n"
        "guard_streams()\n"
        "record = open('record', 'w')\n"
        "print('to the terminal', flush=True)\n"
    )
    (tmp_path / "it.py").write_text(script)
    assert clean(shell(f"{sys.executable} it.py >&- 2>&-", tmp_path))
    assert (tmp_path / "record").read_text() == ""


def test_a_full_pipe_that_does_not_block_is_waited_for_at_rest() -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    content = bytes(range(256)) * 1024  # 256 KiB, more than a pipe holds

    def read_late() -> bytes:
        time.sleep(0.2)
        with os.fdopen(reading, "rb") as pipe:
            return pipe.read()

    with ThreadPoolExecutor(1) as pool:
        arrived = pool.submit(read_late)
        begun, worked = time.monotonic(), time.process_time()
        with Outlet(writing, "w") as outlet:
            assert outlet.write(content) == len(content)
            waited, worked = time.monotonic() - begun, time.process_time() - worked
        assert arrived.result(timeout=60) == content
    assert outlet.failure is None
    assert worked < 0.03 * waited
