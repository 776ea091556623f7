"""A few of the hostile files that `python -m tests.benchmarks.fuzz_readers` draws by thousands."""

from tests.benchmarks.fuzz_readers import fuzz_acceptance, fuzz_documents, fuzz_folders


def test_hostile_documents_are_read_or_refused(tmp_path) -> None:
    took = fuzz_documents(252, 1, tmp_path)
    took += fuzz_acceptance(40, 1, tmp_path / "fit")
    assert took["strip refused"] > 10
    assert took["result read"] > 0
    assert sum(took.values()) == 252 + 80


def test_hostile_run_folders_are_read_or_refused(tmp_path) -> None:
    took = fuzz_folders(14, 1, tmp_path, pages=4)
    assert took["folders"] == 14
    assert took["salvage read"] > 10
    assert took["report read"] > 0
