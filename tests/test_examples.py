"""The examples of the runbooks run as they are written."""

import ast
import re
from pathlib import Path

import pytest

import cell

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "runbooks" / "python.md"


def blocks() -> list[str]:
    """The blocks of Python on the page, in their order."""
    return re.findall(
        r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL
    )


def test_every_function_on_the_page_is_one_of_the_package() -> None:
    used = {
        node.attr
        for block in blocks()
        for node in ast.walk(ast.parse(block))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "cell"
    }
    assert used
    assert used <= set(cell.__all__)
    assert {"fold", "fit_gap", "read_run"} <= used


def test_every_function_of_the_package_says_what_it_does() -> None:
    for name in cell.__all__:
        assert getattr(cell, name).__doc__, name
        assert name == "CellError" or "return" in getattr(cell, name).__annotations__, (
            name
        )


def test_other_names_are_no_part_of_the_package_and_no_seed_is_negative() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'unfold'"):
        _ = cell.unfold
    with pytest.raises(cell.CellError, match="seed: is -1, must be at least 0"):
        cell.fold("denim", seed=-1)
    assert dir(cell) == sorted(cell.__all__)


@pytest.mark.slow
def test_the_page_runs_from_top_to_bottom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    names: dict[str, object] = {}
    for block in blocks():
        exec(compile(block, str(PAGE), "exec"), names)  # noqa: S102  the page is ours
    assert callable(names["verdict_on"])
