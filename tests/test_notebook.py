"""The notebook of the runbooks runs from top to bottom, and the outputs that it holds
are today's.

`python -m tests.test_notebook` runs it and keeps what it shows.
"""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOK = ROOT / "runbooks" / "first-look.ipynb"
PATIENCE = 600  # s for one cell


def executed():
    """The notebook with the outputs of a run in the checkout's folder."""
    import nbclient
    import nbformat

    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=PATIENCE, resources={"metadata": {"path": str(ROOT)}}
    ).execute()
    return notebook


def printed(notebook) -> str:
    """All that its cells printed."""
    outputs = [o for cell in notebook.cells for o in cell.get("outputs", ())]
    return "".join(o["text"] for o in outputs if o["output_type"] == "stream")


def pictures(notebook) -> int:
    """How many pictures its cells show."""
    outputs = [o for cell in notebook.cells for o in cell.get("outputs", ())]
    return sum("image/png" in o.get("data", {}) for o in outputs)


@pytest.mark.slow
def test_notebook_runs_and_shows_what_it_holds() -> None:
    nbformat = pytest.importorskip("nbformat", reason="notebooks cannot be run here")
    kept, now = nbformat.read(NOTEBOOK, as_version=4), executed()
    assert printed(now) == printed(kept)
    assert pictures(now) == pictures(kept) == 2


if __name__ == "__main__":
    import nbformat

    nbformat.write(executed(), NOTEBOOK)
