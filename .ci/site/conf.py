"""Site of the pages: `sphinx-build -W -c .ci/site . FOLDER` in the checkout's root.

Its pages are README, the changelog and the runbooks as they stand; their order is
stated here, and Python's functions are added from their docstrings.
"""

from importlib.metadata import version as version_of

from sphinx.application import Sphinx

project = "Folding cell"
version = release = version_of("folding-cell")
root_doc = "README"
include_patterns = [
    *("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"),
    *("runbooks/*.md", "tests/lab/notes/*.md", "tests/lab/ledgers/*.md"),
]
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
html_theme = "furo"
html_extra_path = ["index.html"]  # leads to README's page
html_show_copyright = False
myst_heading_anchors = 3
autodoc_typehints = "description"
autodoc_member_order = "bysource"

ORDER = {
    "Fold": "fold-a-strip measure-a-strip python benchmark train-a-policy",
    "Find what a model lacks": "find-a-gap own-runs identify-a-robot exam",
    "A cell of one's own": "day-zero first-day-with-a-real-arm calibrate phone "
    "mounting-and-light twin-server",
    "When it stops": "faults camera-frozen-or-moved reflex-recovery version-mismatch",
}
TREE = """
```{{toctree}}
:hidden:
:caption: {caption}

{pages}
```
"""
LABORATORY = """
```{toctree}
:hidden:
:caption: Laboratory
:glob:

tests/lab/notes/*
tests/lab/ledgers/*
```
"""
FUNCTIONS = """
## Every function

```{eval-rst}
.. automodule:: cell
   :members:
   :imported-members:
```
"""


def complete(_: Sphinx, name: str, source: list[str]) -> None:
    """Add the order of pages to README, and the functions to the page on Python."""
    if name == "runbooks/python":
        source[0] += FUNCTIONS
    if name == root_doc:
        for caption, names in ORDER.items():
            pages = "\n".join(f"runbooks/{page}" for page in names.split())
            source[0] += TREE.format(caption=caption, pages=pages)
        source[0] += LABORATORY
        others = "runbooks/architecture\nCONTRIBUTING\nSECURITY\nCHANGELOG"
        source[0] += TREE.format(caption="The project", pages=others)


def setup(app: Sphinx) -> None:
    """Register what completes pages."""
    app.connect("source-read", complete)
