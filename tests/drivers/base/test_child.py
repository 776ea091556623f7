"""A child that answers, fails, dies, hangs or loses its parent: its parent hears of it,
and no process is left.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.base.child import Child, ChildDied, SharedImage, end_with_parent
from tests.support.children import holds

PATIENCE = 30.0  # s


def echo(pipe, image: SharedImage) -> None:
    """Answer each message with itself; some are orders to fail."""
    while (message := pipe.recv()) != "end":
        match message:
            case "raise":
                raise ZeroDivisionError("nobody foresaw this")
            case "hang":
                time.sleep(600.0)
            case "stubborn":
                signal.signal(signal.SIGTERM, signal.SIG_IGN)
            case ("look", shape):
                message = int(image.read(shape).sum())
        pipe.send(message)


def braking(pipe, log: Path) -> None:
    """Note SIGTERM, as an arm that brakes first."""
    signal.signal(signal.SIGTERM, lambda *_: (log.write_text("braked"), sys.exit(0)))
    pipe.send("ready")
    time.sleep(600.0)


def computing(pipe) -> None:
    end_with_parent(pipe)
    time.sleep(600.0)


@pytest.fixture
def child() -> Iterator[Child]:
    image = SharedImage()
    child = Child(echo, image)
    child.image = image
    yield child
    child.kill()
    image.close()


def is_gone(pid: int) -> bool:
    """Whether no process has this ID, not even a zombie."""
    return not Path(f"/proc/{pid}").exists()


def test_child_runs_its_parent_s_code_and_not_what_lies_in_the_current_folder(
    tmp_path, monkeypatch, request
) -> None:
    (tmp_path / "drivers").mkdir()
    (tmp_path / "drivers" / "__init__.py").write_text("raise SystemExit(7)")
    monkeypatch.chdir(tmp_path)
    child = request.getfixturevalue("child")
    child.send("hello")
    assert child.receive(PATIENCE) == "hello"


def test_child_answers_in_order_and_only_when_asked(child) -> None:
    child.send(1)
    child.send("two")
    assert [child.receive(PATIENCE), child.receive(PATIENCE)] == [1, "two"]
    assert child.receive(0.0) is None
    assert not child.ends


def test_child_that_raises_says_what(child) -> None:
    child.send("raise")
    for _ in range(2):
        with pytest.raises(ChildDied, match="ZeroDivisionError: nobody foresaw this"):
            child.receive(PATIENCE)
    child.close()
    assert is_gone(child.pid)


def test_killed_child_leaves_its_messages_its_code_and_no_zombie(child) -> None:
    child.send("said before")
    assert holds(child.pipe.poll)
    os.kill(child.pid, signal.SIGKILL)
    assert holds(lambda: child.ends)
    assert child.receive(PATIENCE) == "said before"
    for _ in range(2):
        with pytest.raises(ChildDied, match="code -9"):
            child.receive(PATIENCE)
    assert is_gone(child.pid)


@pytest.mark.parametrize("before", [None, "hang", "stubborn"])
def test_child_that_stands_still_is_ended_in_time(child, before) -> None:
    if before:
        child.send(before)
    if before == "stubborn":
        assert child.receive(PATIENCE) == before
    os.kill(child.pid, signal.SIGSTOP)
    begun = time.monotonic()
    assert child.receive(0.1) is None
    child.close(patience=0.1)
    assert time.monotonic() - begun < 5.0
    assert is_gone(child.pid)


def test_child_is_asked_to_end_before_it_is_killed(tmp_path) -> None:
    child = Child(braking, tmp_path / "log")
    assert child.receive(PATIENCE) == "ready"
    child.close(patience=0.1)
    assert (tmp_path / "log").read_text() == "braked"
    assert is_gone(child.pid)


@pytest.mark.parametrize("main", ["echo, SharedImage()", "computing"])
def test_child_ends_with_its_parent(main) -> None:
    script = f"""
import time
from drivers.base.child import Child, SharedImage
from tests.drivers.base.test_child import computing, echo
print(Child({main}).pid, flush=True)
time.sleep(600)
"""
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE
    ) as parent:
        pid = int(parent.stdout.readline())
        parent.kill()
    assert holds(
        lambda: is_gone(pid) or "zombie" in Path(f"/proc/{pid}/status").read_text()
    )
