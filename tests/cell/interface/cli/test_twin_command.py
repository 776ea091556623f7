"""`cell twin serve`: where it listens, what it refuses, how it ends."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.commands import run
from tests.support.fci_clients import served
from tests.support.fci_wire import RawArm

FAULTS = """\
schema: 1
faults:
  - {at: 0, kind: wrong_version, version: 8}
"""


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Children heed an interrupt, even where a shell began the tests in its
    background.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_served_twin_says_where_it_is_obeys_its_script_and_ends_on_interrupt(
    tmp_path,
) -> None:
    script = tmp_path / "faults.yaml"
    script.write_text(FAULTS)
    with served("--faults", script) as (told, process):
        assert told["address"].startswith("127.")
        assert (told["arm"], told["hand"], told["clock"]) == (1337, 1338, "lock-step")
        with RawArm(told["address"]) as arm:
            assert arm.connected == (1, 8)
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema: 1\nfaults: [{at: 1, kind: fire}]\n", "kind"),
        ("schema: 1\nfaults: [{kind: tcp_drop}]\n", "at: is missing"),
        (
            "schema: 1\nfaults: [{at: 1, kind: reflex, error: hunger}]\n",
            "no error of the robot",
        ),
        ("schema: 1\nfaults: [{at: 1, kind: contact, force: [0, 0, 0]}]\n", "not zero"),
        ("schema: 1\nfaults: [{at: 1, kind: freeze, duration: -1}]\n", "duration"),
        ("faults: 3\n", "faults"),
    ],
)
def test_fault_script_that_says_nothing_possible_is_refused(
    monkeypatch, capsys, tmp_path: Path, text: str, said: str
) -> None:
    script = tmp_path / "faults.yaml"
    script.write_text(text)
    assert run(monkeypatch, "twin serve --faults", script) == 2
    told = capsys.readouterr()
    assert str(script) in told.err
    assert said in told.err


@pytest.mark.parametrize("address", ["robot", "127.0.0", "203.0.113.9"])
def test_address_that_is_not_this_machines_is_refused(
    monkeypatch, capsys, address: str
) -> None:
    assert run(monkeypatch, "twin serve --address", address) == 2
    assert "address" in capsys.readouterr().err
