"""Command line of the laboratory, `python -m tests.lab COMMAND`, with `--help` for
each.
"""

import ast
import sys
from importlib import import_module
from pathlib import Path

import typer

from cell.__main__ import main
from tests.lab.exam_command import exam
from tests.lab.study_command import study

HERE = Path(__file__).parent
SCRIPTS = {
    **{
        name: f"tests.lab.{name.replace('-', '_')}"
        for name in ("fuzz-readers", "fuzz-packets")
    },
    "mutants": "tests.lab.mutants",
    **{
        path.stem.replace("_", "-"): f"tests.lab.benchmarks.{path.stem}"
        for path in sorted((HERE / "benchmarks").glob("[!_]*.py"))
    },
}
PASS_ON = {
    "allow_extra_args": True,
    "ignore_unknown_options": True,
    "help_option_names": [],
}

app = typer.Typer(
    name="python -m tests.lab",
    help="Measure the cell, its diagnosis and its tests.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command()(exam)
app.command()(study)


def script(given: typer.Context) -> None:
    """Run the `main` of the module of this name with the arguments that follow it."""
    module = import_module(SCRIPTS[str(given.info_name)])
    command = typer.Typer(add_completion=False, rich_markup_mode=None)
    command.command()(module.main)
    sys.exit(
        command(given.args, standalone_mode=False, prog_name=given.command_path) or 0
    )


def _sentence(module: str) -> str:
    """First line of a module's docstring, read without an import."""
    path = HERE.parents[1] / f"{module.replace('.', '/')}.py"
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.partition("\n")[0].partition(": `")[0]


for name, module in SCRIPTS.items():
    app.command(name, help=_sentence(module), context_settings=PASS_ON)(script)

if __name__ == "__main__":
    main(app)
