"""A few of the hostile files that `python -m tests.benchmarks.fuzz_readers` draws by thousands."""

from tests.benchmarks.fuzz_readers import fuzz_acceptance, fuzz_documents, fuzz_folders


def test_hostile_documents_are_read_or_refused(tmp_path) -> None:
    took = fuzz_documents(450, 1, tmp_path)
    took += fuzz_acceptance(40, 1, tmp_path / "fit")
    assert took["strip refused"] > 20
    assert took["result read"] > 2
    assert sum(took.values()) == 450 + 80


def test_hostile_run_folders_are_read_or_refused(tmp_path) -> None:
    took = fuzz_folders(40, 1, tmp_path, pages=8)
    assert took["folders"] == 40
    assert took["salvage read"] > 30
    assert took["report read"] > 2
