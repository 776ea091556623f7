"""A few of the hostile files that `python -m tests.lab fuzz-readers` draws by thousands."""

import time

import pytest

from tests.lab.fuzz_readers import (
    TooLong,
    asleep,
    fuzz_acceptance,
    fuzz_documents,
    fuzz_folders,
    limited,
)


@pytest.mark.slow
def test_hostile_documents_are_read_or_refused(tmp_path) -> None:
    took = fuzz_documents(126, 1, tmp_path)
    took += fuzz_acceptance(12, 1, tmp_path / "fit")
    assert took["strip refused"] > 3
    assert sum(count for kind, count in took.items() if kind.endswith("read")) > 0
    assert sum(took.values()) == 126 + 24


@pytest.mark.slow
def test_hostile_run_folders_are_read_or_refused(tmp_path) -> None:
    took = fuzz_folders(5, 1, tmp_path, pages=2)
    assert took["folders"] == 5
    assert took["salvage read"] > 2
    assert took["report read"] > 0


def test_only_sleep_counts_as_waiting() -> None:
    before, ends = asleep(), time.thread_time() + 0.1
    while time.thread_time() < ends:
        pass
    assert asleep() - before < 0.1
    with pytest.raises(TooLong), limited(0.02):
        time.sleep(5.0)
